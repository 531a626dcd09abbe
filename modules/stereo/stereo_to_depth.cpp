#include "stereo/stereo_to_depth.h"

#include <algorithm>
#include <utility>

namespace wagonsight {

Result<StereoToDepth> StereoToDepth::create(StereoRectification rectification,
                                            const StereoToDepthOptions& options) {
  auto matcher = StereoMatcher::create(rectification.camera.width, rectification.camera.height,
                                       options.matcher);
  if (!matcher) return fail(matcher.error().message);
  return StereoToDepth(std::move(rectification), options, std::move(*matcher));
}

StereoToDepth::StereoToDepth(StereoRectification rectification, const StereoToDepthOptions& options,
                             StereoMatcher matcher)
    : rectification_(std::move(rectification)),
      options_(options),
      matcher_(std::move(matcher)),
      gate_(rectification_.camera.width, rectification_.camera.height, options.gate),
      table_(rectification_.camera.fx, rectification_.baseline, options.far_m),
      left_(rectification_.left.size()),
      right_(rectification_.right.size()),
      disparity_(rectification_.left.size()),
      depth_(rectification_.left.size()) {}

GrayImage StereoToDepth::rectified(const AlignedArray<std::uint16_t>& image) const {
  return {image.data(), format_, rectification_.camera.width, rectification_.camera.height};
}

DepthImage StereoToDepth::convert(const FrameSlot& slot, bool whole,
                                  std::span<const PixelRect> feedback) {
  const int width = rectification_.camera.width, height = rectification_.camera.height;
  const bool is_gray = slot.format == PixelFormat::kGray8 || slot.format == PixelFormat::kGray16;
  if (!is_gray || slot.width != width || slot.height != height ||
      slot.bytes.size() < 2 * slot.image_bytes()) {
    ++refused_;
    return {};
  }
  format_ = slot.format;
  const std::byte* pixels = slot.bytes.data();
  rectify({pixels, format_, width, height}, rectification_.left, left_.data());
  rectify({pixels + slot.image_bytes(), format_, width, height}, rectification_.right,
          right_.data());

  const double since_whole = to_seconds(slot.instant - matched_whole_);
  const bool due = !has_matched_whole_ || since_whole >= options_.whole_every_s;
  const auto regions = gate_.regions(left(), whole || due, feedback);
  std::int64_t matched = 0;
  for (const PixelRect& r : regions)
    matched += static_cast<std::int64_t>(r.x1 - r.x0) * (r.y1 - r.y0);
  if (matched == static_cast<std::int64_t>(width) * height) {
    has_matched_whole_ = true;
    matched_whole_ = slot.instant;
  }
  matched_share_ = static_cast<double>(matched) / (static_cast<double>(width) * height);
  matcher_.match_regions(left(), right(), regions, {disparity_.data(), width, height});
  table_.convert({disparity_.data(), width, height}, {depth_.data(), width, height});
  return {depth_.data(), width, height};
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
