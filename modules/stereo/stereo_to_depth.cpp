#include "stereo/stereo_to_depth.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/check.h"

namespace wagonsight {
namespace {

// As the camera took it; image 0 is the left one.
GrayImage raw_image(const FrameSlot& slot, int index) {
  return {slot.bytes.data() + static_cast<std::size_t>(index) * slot.image_bytes(), slot.format,
          slot.width, slot.height};
}

ChangeGateOptions gate_options(const StereoToDepthOptions& options) {
  ChangeGateOptions gate = options.gate;
  gate.whole_every_s = options.whole_every_s;
  gate.whole_phase_s = options.whole_phase_s;
  gate.feedback_every_s = options.feedback_every_s;
  return gate;
}

}  // namespace

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

StereoToDepth::StereoToDepth(StereoRectification rectification, const StereoToDepthOptions& options)
    : rectification_(std::move(rectification)),
      options_(options),
      gate_(rectification_.camera.width, rectification_.camera.height, gate_options(options)),
      table_(rectification_.camera.fx, rectification_.baseline, options.far_m),
      alignment_(rectification_.camera.width, rectification_.camera.height,
                 {.disparity_min = options.matcher.disparity_min,
                  .disparity_count = options.matcher.disparity_count}),
      depth_(static_cast<std::size_t>(rectification_.camera.width) *
             static_cast<std::size_t>(rectification_.camera.height)),
      sigma_(depth_.size()) {
  // One number serves as 64ths of a pixel and as 16ths of the noise.
  static_assert(kDisparitySigmaPx * kDisparityScale == 16);
}

// Image 0 is the left one. Only what rectify_rect() was asked for is there of it.
GrayImage StereoToDepth::rectified(const FrameSlot& slot, int index) {
  if (table_of(index).empty()) return raw_image(slot, index);
  AlignedArray<std::uint16_t>& out = index == 0 ? workspace_->left : workspace_->right;
  return {out.data(), slot.format, slot.width, slot.height};
}

void StereoToDepth::rectify_rect(const FrameSlot& slot, int index, const PixelRect& rect) {
  if (table_of(index).empty()) return;
  AlignedArray<std::uint16_t>& out = index == 0 ? workspace_->left : workspace_->right;
  rectify_part(raw_image(slot, index), table_of(index), rect, out.data());
}

void StereoToDepth::judge_exposure(const FrameSlot& slot) {
  const int full_scale = slot.format == PixelFormat::kGray8 ? 255 : options_.full_scale;
  report_.seen = measure_exposure(raw_image(slot, 0), mask_, full_scale, rectification_.left);
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

void StereoToDepth::match(const FrameSlot& slot, std::span<const PixelRect> regions) {
  const int width = slot.width, height = slot.height;
  StereoMatcher& matcher = workspace_->matcher;
  for (const PixelRect& region : regions) {
    rectify_rect(slot, 0, matcher.reach_left(region));
    rectify_rect(slot, 1, matcher.reach_right(region));
  }
  const ImageView<std::int16_t> disparity{workspace_->disparity.data(), width, height};
  matcher.match_regions(rectified(slot, 0), rectified(slot, 1), regions, disparity,
                        raw_image(slot, 0), {sigma_.data(), width, height});
  // Elsewhere the disparities are another camera's, and the depth stays what it was.
  const ImageView<std::uint16_t> depth{depth_.data(), width, height};
  for (const PixelRect& region : regions)
    table_.convert({disparity.pixels, width, height}, depth, region);
}

DepthImage StereoToDepth::convert(const FrameSlot& slot, bool whole,
                                  std::span<const PixelRect> feedback, StereoWorkspace& workspace) {
  const int width = rectification_.camera.width, height = rectification_.camera.height;
  WS_CHECK(workspace.fits(width, height), "workspace of %d x %d for %d x %d",
           workspace.matcher.width(), workspace.matcher.height(), width, height);
  workspace_ = &workspace;
  const bool is_gray = slot.format == PixelFormat::kGray8 || slot.format == PixelFormat::kGray16;
  if (!is_gray || slot.width != width || slot.height != height ||
      slot.bytes.size() < 2 * slot.image_bytes()) {
    ++report_.refused;
    return {};
  }
  judge_exposure(slot);
  report_.matched_share = 0;
  if (!report_.usable) return {};  // the gate's reference stays what it was
  // What does not change keeps its depth; it is looked at again at a rhythm.
  const auto regions =
      gate_.regions(raw_image(slot, 0), whole, feedback, rectification_.left, slot.instant);
  std::int64_t matched = 0;
  for (const PixelRect& r : regions)
    matched += static_cast<std::int64_t>(r.x1 - r.x0) * (r.y1 - r.y0);
  const auto all = static_cast<std::int64_t>(width) * height;
  report_.matched_share = static_cast<double>(matched) / static_cast<double>(all);
  if (matched > 0) match(slot, regions);
  check_alignment(slot);
  return {depth_.data(), width, height};
}

// A band of rows at a time, so that no instant waits long for it.
void StereoToDepth::check_alignment(const FrameSlot& slot) {
  if (options_.aligned_every_s <= 0) return;
  const double band_every_s = options_.aligned_every_s / alignment_.bands();
  if (has_checked_ && to_seconds(slot.instant - checked_) < band_every_s) return;
  checked_ = slot.instant;
  // The cameras take turns with this, too.
  if (!has_checked_) checked_ -= from_seconds(std::fmod(options_.whole_phase_s, band_every_s));
  has_checked_ = true;
  if (next_band_ == 0) alignment_.begin();
  const PixelRect rows = alignment_.rows_of(next_band_);
  for (const int index : {0, 1}) rectify_rect(slot, index, rows);
  alignment_.measure_band(rectified(slot, 0), rectified(slot, 1), next_band_);
  if (++next_band_ < alignment_.bands()) return;
  next_band_ = 0;
  judge_alignment();
}

// The figure follows the checks slowly, so that one of a crowd close by does not count for much.
void StereoToDepth::judge_alignment() {
  constexpr int kInARow = 3;
  constexpr double kGain = 0.5;
  const RowAlignment rows = alignment_.result();
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
