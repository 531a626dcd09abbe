#include <cstdint>
#include <cstdlib>
#include <vector>

#include "recording/recording_reader.h"
#include "recording/ros_messages.h"
#include "unit/recording/synthetic_recording.h"

// Any bytes as a recording: refused, or frames that fit the slots the reader asked for.
namespace {

using namespace wagonsight;  // NOLINT(google-build-using-namespace): one short target

void require(bool holds) {
  if (!holds) std::abort();
}

// More frames than any edit of the small recording can leave; a reader that goes in circles shows.
constexpr int kReadsMax = 1000;
constexpr std::size_t kSlotBytesMax = std::size_t{64} << 20;

void read_all(std::span<const std::byte> file, DamagePolicy policy) {
  const auto reader = RecordingReader::open(file, policy);
  if (!reader) return require(!reader.error().message.empty());
  const std::size_t slot_bytes = (*reader)->slot_bytes();
  if (slot_bytes > kSlotBytesMax) return;  // an honest header of a large image
  std::vector<std::byte> memory(slot_bytes);
  FrameSlot slot;
  slot.bytes = memory;
  int reads = 0;
  while (true) {
    const auto more = (*reader)->next(slot);
    require(++reads < kReadsMax);
    if (!more) {
      require(!more.error().message.empty());
      continue;
    }
    if (!*more) break;
    require(slot.sensor_index < (*reader)->rig().sensors.size());
    require(slot.image_bytes() <= memory.size());
  }
}

// The messages by themselves, which sums protect inside a recording.
void decode(std::span<const std::byte> bytes) {
  if (const auto image = decode_image(bytes)) {
    require(image->data.data() >= bytes.data());
    require(image->data.data() + image->data.size() <= bytes.data() + bytes.size());
  }
  (void)decode_camera_info(bytes);
  (void)decode_frame_info(bytes);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto input = std::as_bytes(std::span(data, size));
  const std::vector<std::byte> raw(input.begin(), input.end());
  read_all(raw, DamagePolicy::kSkip);
  decode(raw);

  // Edits of a good recording: four bytes an edit, where (24 bit) and what; the first byte may cut
  // the file short.
  static const std::vector<std::byte> good = wagonsight::testing::record(6);
  if (size == 0) return 0;
  std::vector<std::byte> edited(
      good.begin(),
      good.end() - static_cast<std::ptrdiff_t>(data[0] < 64 ? good.size() * data[0] / 64 : 0));
  for (std::size_t i = 1; i + 4 <= size && !edited.empty(); i += 4) {
    const std::size_t at = (data[i] * 65536U + data[i + 1] * 256U + data[i + 2]) % edited.size();
    edited[at] = std::byte(data[i + 3]);
  }
  read_all(edited, DamagePolicy::kSkip);
  read_all(edited, DamagePolicy::kStop);
  return 0;
}
