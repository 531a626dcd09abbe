#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/result.h"
#include "base/time.h"
#include "frame/frame.h"
#include "rig/rig.h"
#include "stereo/alignment.h"
#include "stereo/change_gate.h"
#include "stereo/depth.h"
#include "stereo/exposure.h"
#include "stereo/matcher.h"
#include "stereo/rectify.h"

// A stereo camera as one more depth sensor: rectify, match where something changed, millimetres.
namespace wagonsight {

struct StereoToDepthOptions {
  MatcherOptions matcher;
  ChangeGateOptions gate;
  double whole_every_s = 4.0;     // the whole image is matched this often, a strip at a time
  double feedback_every_s = 0.5;  // the regions of feedback are matched this often, changes always
  double whole_phase_s = 0.0;     // so much earlier the first time: cameras take turns
  double aligned_every_s = 5.0;   // the rows' alignment is known this often; 0: never
  double misaligned_px = 1.0;     // half of the census window: from here on matches go wrong
  double far_m = 20.0;            // farther readings are dropped
  int full_scale = 4095;          // the largest gray value
  ExposureLimits exposure;
};

// What converting one pair needs to write in: the matcher's memory and the images of the pair in
// work. Nothing of it lasts until the next pair, so the cameras of one size that one thread
// converts share one.
class StereoWorkspace {
 public:
  // Allocates. The Error is the matcher's.
  static Result<std::unique_ptr<StereoWorkspace>> create(int width, int height,
                                                         const MatcherOptions& options);
  bool fits(int width, int height) const {
    return matcher.width() == width && matcher.height() == height;
  }

  StereoMatcher matcher;
  AlignedArray<std::uint16_t> left, right;  // rectified; as bytes for kGray8
  AlignedArray<std::int16_t> disparity;

 private:
  explicit StereoWorkspace(StereoMatcher the_matcher);
};

// What is told of a camera besides its depth.
struct StereoReport {
  double matched_share = 0;    // of the last image, 0 .. 1
  bool usable = true;          // the last image; else it was too dark or too bright to match
  std::uint64_t unusable = 0;  // images so far
  std::uint64_t refused = 0;   // slots that did not fit
  ExposureStatistics seen;     // of the last image
  Exposure next;               // what the law asks for; zeros: the camera's cannot be chosen
  double row_offset_px = 0;    // right rows minus left ones, by the last checks
  int row_checks = 0;          // that told something, so far
  bool misaligned = false;     // three checks in a row were beyond the limit
};

class StereoToDepth {
 public:
  // Allocates everything convert() needs; `rectification` is moved in. Without tables the images
  // are taken for rectified ones.
  explicit StereoToDepth(StereoRectification rectification,
                         const StereoToDepthOptions& options = {});

  // Pixels that say something of the light: a bit a pixel of the rectified image, 1 inside (no
  // window, no screen). All of them without it. Allocates.
  void set_exposure_mask(std::vector<std::uint64_t> mask) { mask_ = std::move(mask); }

  // The slot holds the left image and then the right one, of the rectification's size, as kGray8 or
  // kGray16. `whole` asks for the whole image (while the background is learned), `feedback` for
  // regions of the rectified left image that are matched in any case. `workspace` is of this size,
  // any one each time. The depth image is this object's, valid until the next call; an empty one
  // (no pixels) when the slot does not fit or the image is unusable, which is told. Never
  // allocates; one thread at a time, and one at a time in a workspace.
  DepthImage convert(const FrameSlot& slot, bool whole, std::span<const PixelRect> feedback,
                     StereoWorkspace& workspace);

  // Of the image that convert() returned last.
  std::span<std::byte> depth_bytes() {
    return std::as_writable_bytes(std::span(depth_.data(), depth_.size()));
  }

  // Of its readings, a byte a pixel: how uncertain each is, in 16ths of what its depth alone makes
  // it (stereo_noise), 16 or more.
  std::span<const std::uint8_t> noise() const { return {sigma_.data(), sigma_.size()}; }

  const StereoReport& report() const { return report_; }
  const Camera& camera() const { return rectification_.camera; }

 private:
  const std::vector<RectifyEntry>& table_of(int index) const {
    return index == 0 ? rectification_.left : rectification_.right;
  }
  GrayImage rectified(const FrameSlot& slot, int index);
  void rectify_rect(const FrameSlot& slot, int index, const PixelRect& rect);
  void judge_exposure(const FrameSlot& slot);
  void match(const FrameSlot& slot, std::span<const PixelRect> regions);
  void check_alignment(const FrameSlot& slot);
  void judge_alignment();

  StereoRectification rectification_;
  StereoWorkspace* workspace_ = nullptr;  // during a call
  StereoToDepthOptions options_;
  ChangeGate gate_;
  DepthTable table_;
  AlignmentCheck alignment_;
  std::vector<std::uint64_t> mask_;
  AlignedArray<std::uint16_t> depth_;
  AlignedArray<std::uint8_t> sigma_;  // of the disparities that they were, in 64ths of a pixel
  bool has_checked_ = false;
  HostTime checked_{};
  int next_band_ = 0;  // of the alignment check
  int misaligned_in_a_row_ = 0;
  StereoReport report_;
};

// What the rig says of such a sensor: camera, baseline and noise. Pose, name, rate and trims are
// the caller's.
RigSensor stereo_sensor(const StereoRectification& rectification);

}  // namespace wagonsight
