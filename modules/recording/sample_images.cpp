#include "recording/sample_images.h"

#include <algorithm>

namespace wagonsight {
namespace {

// Calls visit(slot) for every frame and rewinds.
template <class Visit>
Result<void> visit_frames(RecordingReader& reader, Visit&& visit) {
  std::vector<std::byte> memory(reader.slot_bytes());
  FrameSlot slot;
  slot.bytes = memory;
  while (true) {
    const auto more = reader.next(slot);
    if (!more) return tl::unexpected(more.error());
    if (!*more) break;
    visit(slot);
  }
  reader.rewind();
  return {};
}

}  // namespace

std::vector<DepthImage> SampleImages::views() const {
  std::vector<DepthImage> result;
  for (const auto& image : pixels) result.push_back({image.data(), width, height});
  return result;
}

Result<std::uint64_t> count_frames(RecordingReader& reader) {
  std::uint64_t frames = reader.stated_frame_count();
  if (frames > 0) return frames;
  if (auto done = visit_frames(reader, [&](const FrameSlot&) { ++frames; }); !done)
    return tl::unexpected(done.error());
  return frames;
}

Result<SampleImages> sample_images(RecordingReader& reader) {
  constexpr std::uint64_t kImages = 12;
  const auto frames = count_frames(reader);
  if (!frames) return tl::unexpected(frames.error());
  const Camera& camera = reader.rig().sensors[0].camera;
  SampleImages images{camera.width, camera.height, {}};
  const std::uint64_t step = std::max<std::uint64_t>(1, *frames / kImages);
  std::uint64_t index = 0;
  const auto take = [&](const FrameSlot& slot) {
    if (slot.sensor_index != 0 || slot.format != PixelFormat::kDepth16) return;
    if (index++ % step != step / 2 || slot.damaged) return;
    const auto pixels = slot.depth_pixels();
    images.pixels.emplace_back(pixels.begin(), pixels.end());
  };
  if (auto done = visit_frames(reader, take); !done) return tl::unexpected(done.error());
  return images;
}

}  // namespace wagonsight
