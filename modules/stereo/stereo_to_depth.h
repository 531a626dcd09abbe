#pragma once

#include <cstdint>
#include <span>

#include "base/result.h"
#include "base/time.h"
#include "frame/frame.h"
#include "rig/rig.h"
#include "stereo/change_gate.h"
#include "stereo/depth.h"
#include "stereo/matcher.h"
#include "stereo/rectify.h"

// A stereo camera as one more depth sensor: rectify, match where something changed, millimetres.
namespace wagonsight {

struct StereoToDepthOptions {
  MatcherOptions matcher;
  ChangeGateOptions gate;
  double whole_every_s = 2.0;  // the whole image is matched at least this often
  double far_m = 20.0;         // farther readings are dropped
};

class StereoToDepth {
 public:
  // Allocates everything convert() needs; `rectification` is copied. The Error is the matcher's.
  static Result<StereoToDepth> create(StereoRectification rectification,
                                      const StereoToDepthOptions& options = {});

  // The slot holds the left image and then the right one, of the rectification's size, as kGray8 or
  // kGray16. `whole` asks for the whole image (while the background is learned), `feedback` for
  // regions of the rectified left image that are matched in any case. The depth image is this
  // object's, valid until the next call; an empty one (no pixels) when the slot does not fit, which
  // is counted. Never allocates; one thread at a time.
  DepthImage convert(const FrameSlot& slot, bool whole, std::span<const PixelRect> feedback);

  // Of the last image, 0 .. 1; for the metrics.
  double matched_share() const { return matched_share_; }
  std::uint64_t refused() const { return refused_; }
  const Camera& camera() const { return rectification_.camera; }
  // The rectified images of the last call, for the row alignment check.
  GrayImage left() const { return rectified(left_); }
  GrayImage right() const { return rectified(right_); }

 private:
  StereoToDepth(StereoRectification rectification, const StereoToDepthOptions& options,
                StereoMatcher matcher);
  GrayImage rectified(const AlignedArray<std::uint16_t>& image) const;

  StereoRectification rectification_;
  StereoToDepthOptions options_;
  StereoMatcher matcher_;
  ChangeGate gate_;
  DepthTable table_;
  PixelFormat format_ = PixelFormat::kGray16;
  AlignedArray<std::uint16_t> left_, right_;  // as bytes for kGray8
  AlignedArray<std::int16_t> disparity_;
  AlignedArray<std::uint16_t> depth_;
  bool has_matched_whole_ = false;
  HostTime matched_whole_{};
  double matched_share_ = 0;
  std::uint64_t refused_ = 0;
};

// What the rig says of such a sensor: camera, baseline and noise. Pose, name, rate and trims are
// the caller's.
RigSensor stereo_sensor(const StereoRectification& rectification);

}  // namespace wagonsight
