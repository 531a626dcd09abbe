#include "stereo/stereo_to_depth.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/check.h"

namespace wagonsight {

Result<std::unique_ptr<StereoWorkspace>> StereoWorkspace::create(int width, int height,
                                                                 const MatcherOptions& options) {
  auto matcher = StereoMatcher::create(width, height, options);
  if (!matcher) return tl::unexpected(matcher.error());
  return std::unique_ptr<StereoWorkspace>(new StereoWorkspace(std::move(*matcher)));
}

StereoWorkspace::StereoWorkspace(StereoMatcher the_matcher)
    : matcher(std::move(the_matcher)),
      left(static_cast<std::size_t>(matcher.width()) * static_cast<std::size_t>(matcher.height())),
      right(left.size()),
      disparity(left.size()) {}

StereoToDepth::StereoToDepth(StereoRectification rectification, StereoWorkspace& workspace,
                             const StereoToDepthOptions& options)
    : rectification_(std::move(rectification)),
      workspace_(&workspace),
      options_(options),
      gate_(rectification_.camera.width, rectification_.camera.height, options.gate),
      table_(rectification_.camera.fx, rectification_.baseline, options.far_m),
      alignment_(rectification_.camera.width, rectification_.camera.height,
                 {.disparity_min = options.matcher.disparity_min,
                  .disparity_count = options.matcher.disparity_count}),
      depth_(workspace.left.size()) {
  WS_CHECK(workspace.fits(rectification_.camera.width, rectification_.camera.height), "%d x %d",
           rectification_.camera.width, rectification_.camera.height);
}

// Image 0 is the left one. Only its rows [first_row, end_row) are made.
GrayImage StereoToDepth::rectified(const FrameSlot& slot, int index, int first_row, int end_row) {
  const GrayImage raw{slot.bytes.data() + static_cast<std::size_t>(index) * slot.image_bytes(),
                      slot.format, slot.width, slot.height};
  const auto& table = index == 0 ? rectification_.left : rectification_.right;
  if (table.empty()) return raw;
  AlignedArray<std::uint16_t>& out = index == 0 ? workspace_->left : workspace_->right;
  const auto row = static_cast<std::size_t>(slot.width);
  const std::size_t first = static_cast<std::size_t>(first_row) * row;
  rectify(raw, RectifyTable(table).subspan(first, static_cast<std::size_t>(end_row) * row - first),
          reinterpret_cast<std::byte*>(out.data()) + first * bytes_per_pixel(slot.format));
  return {out.data(), slot.format, slot.width, slot.height};
}

void StereoToDepth::judge_exposure(const FrameSlot& slot, const GrayImage& left) {
  const int full_scale = slot.format == PixelFormat::kGray8 ? 255 : options_.full_scale;
  report_.seen = measure_exposure(left, mask_, full_scale);
  const ExposureDecision decision = next_exposure(
      report_.seen,
      {static_cast<double>(slot.exposure.shutter_us), static_cast<double>(slot.exposure.gain_db)},
      options_.exposure);
  report_.usable = decision.usable;
  if (!decision.usable) ++report_.unusable;
  report_.next = {};
  if (slot.exposure.shutter_us > 0)
    report_.next = {static_cast<float>(decision.next.shutter_us),
                    static_cast<float>(decision.next.gain_db)};
}

bool StereoToDepth::wants_whole(HostTime instant) const {
  return !has_matched_whole_ || to_seconds(instant - matched_whole_) >= options_.whole_every_s;
}

void StereoToDepth::match(const FrameSlot& slot, const GrayImage& left,
                          std::span<const PixelRect> regions) {
  const int width = left.width, height = left.height;
  constexpr int kRowsAround = 16;  // the paths' run-up, and the census
  int first_row = height, end_row = 0;
  for (const PixelRect& region : regions) {
    first_row = std::min(first_row, region.y0);
    end_row = std::max(end_row, region.y1);
  }
  const GrayImage right = rectified(slot, 1, std::max(first_row - kRowsAround, 0),
                                    std::min(end_row + kRowsAround, height));
  const ImageView<std::int16_t> disparity{workspace_->disparity.data(), width, height};
  workspace_->matcher.match_regions(left, right, regions, disparity);
  // Elsewhere the disparities are another camera's, and the depth stays what it was.
  const ImageView<std::uint16_t> depth{depth_.data(), width, height};
  for (const PixelRect& region : regions)
    table_.convert({disparity.pixels, width, height}, depth, region);
  const bool is_whole = regions.size() == 1 && regions[0] == PixelRect{0, 0, width, height};
  if (!is_whole) return;
  matched_whole_ = slot.instant;
  if (!has_matched_whole_) matched_whole_ -= from_seconds(options_.whole_phase_s);
  has_matched_whole_ = true;
  check_alignment(slot.instant, left, right);
}

DepthImage StereoToDepth::convert(const FrameSlot& slot, bool whole,
                                  std::span<const PixelRect> feedback) {
  const int width = rectification_.camera.width, height = rectification_.camera.height;
  const bool is_gray = slot.format == PixelFormat::kGray8 || slot.format == PixelFormat::kGray16;
  if (!is_gray || slot.width != width || slot.height != height ||
      slot.bytes.size() < 2 * slot.image_bytes()) {
    ++report_.refused;
    return {};
  }
  const GrayImage left = rectified(slot, 0, 0, height);
  judge_exposure(slot, left);
  report_.matched_share = 0;
  if (!report_.usable) return {};  // the gate's reference stays what it was
  // What does not change keeps its depth; it is looked at again at a rhythm.
  const bool feeds_back = to_seconds(slot.instant - fed_back_) >= options_.feedback_every_s;
  if (feeds_back) fed_back_ = slot.instant;
  const auto regions = gate_.regions(left, whole || wants_whole(slot.instant),
                                     feeds_back ? feedback : std::span<const PixelRect>{});
  std::int64_t matched = 0;
  for (const PixelRect& r : regions)
    matched += static_cast<std::int64_t>(r.x1 - r.x0) * (r.y1 - r.y0);
  const auto all = static_cast<std::int64_t>(width) * height;
  report_.matched_share = static_cast<double>(matched) / static_cast<double>(all);
  if (matched > 0) match(slot, left, regions);
  return {depth_.data(), width, height};
}

// The figure follows the checks slowly, so that one of a crowd close by does not count for much.
void StereoToDepth::check_alignment(HostTime instant, const GrayImage& left,
                                    const GrayImage& right) {
  constexpr int kInARow = 3;
  constexpr double kGain = 0.5;
  if (options_.aligned_every_s <= 0) return;
  if (has_checked_ && to_seconds(instant - checked_) < options_.aligned_every_s) return;
  has_checked_ = true;
  checked_ = instant;
  const RowAlignment rows = alignment_.measure(left, right);
  if (!rows.reliable) return;
  const double gain = report_.row_checks++ == 0 ? 1.0 : kGain;
  report_.row_offset_px += gain * (rows.median_offset_px - report_.row_offset_px);
  const bool beyond = std::abs(rows.median_offset_px) > options_.misaligned_px;
  misaligned_in_a_row_ = beyond ? misaligned_in_a_row_ + 1 : 0;
  report_.misaligned = misaligned_in_a_row_ >= kInARow;
}

RigSensor stereo_sensor(const StereoRectification& rectification) {
  RigSensor sensor;
  sensor.kind = SensorKind::kStereo;
  sensor.camera = rectification.camera;
  sensor.stereo.baseline = rectification.baseline;
  sensor.noise = stereo_noise(rectification.camera.fx, rectification.baseline);
  return sensor;
}

}  // namespace wagonsight
