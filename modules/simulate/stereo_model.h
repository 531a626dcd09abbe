#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "frame/frame.h"
#include "rig/rig.h"
#include "rig/stereo_pair.h"
#include "simulate/stereo_imager.h"
#include "simulate/world.h"

namespace wagonsight {

// One simulated stereo camera: turns the world at an instant into the gray images of both imagers,
// 12 bits a pixel, taken at one moment with one shutter and gain. Both are cast from where the
// imagers are, so the disparity between them is the truth; lens blur, vignetting, saturation and
// the noise of sensor and photons follow. Allocates only when made. One thread.
class StereoModel {
 public:
  StereoModel(const Scene& scene, std::size_t sensor, std::uint64_t seed);

  // The left image and then the right one, width() * height() values of 0 .. 4095 each, row by
  // row; `number` keys the noise of the frame.
  void render(World& world, HostTime instant, std::uint32_t number, const Exposure& exposure,
              std::span<std::uint16_t> pair);

  // What the rectified left imager S would see without error: inverse depths (1/m), 0 where there
  // is nothing or a pane, which has no truth. `tags` (whose pixel it is, as KinectModel::tag_at)
  // may be empty. For tests and measurements: allocates at the first call.
  void truth(World& world, HostTime instant, std::span<float> inverse_depth,
             std::span<std::int32_t> tags = {});

  int width() const { return imagers_.left.width; }
  int height() const { return imagers_.left.height; }
  const StereoGeometry& imagers() const { return imagers_; }
  const RectifiedPair& rectified() const { return pair_; }
  static constexpr Exposure kFirstExposure{2000, 0};
  static constexpr int kFullScale = 4095;

 private:
  static constexpr std::size_t kPartsMax = 8192;
  static constexpr std::size_t kNoiseValues = 1U << 14U;
  struct Knock {
    double moved = 0, bent = 0;
    bool operator==(const Knock&) const = default;
  };

  Knock knock_at(double seconds) const;
  std::size_t pose_index(double seconds) const;
  Rigid X_WS_of(const Knock& knock) const;
  void gather(World& world, HostTime instant);
  void add(const Parts& parts, std::uint64_t who);
  void develop(const StereoImager& imager, std::uint64_t key, const Exposure& exposure,
               std::span<std::uint16_t> out);
  void blur_row(int v);
  const float* noise_row(std::uint64_t key, int v) const;

  const Scene* scene_;
  std::size_t sensor_;
  std::uint64_t seed_;
  float noise_;
  StereoGeometry imagers_;
  RectifiedPair pair_;
  std::vector<RoomPart> room_;
  SurfaceTextures textures_;
  std::vector<Knock> knocks_;  // by pose of the imagers
  StereoImager left_, right_;
  std::unique_ptr<StereoImager> ideal_;  // at S, for truth()
  std::vector<float> ideal_radiance_;
  std::vector<VisiblePart> parts_;  // never beyond its first capacity
  Illumination lit_;
  std::vector<float> radiance_, row_;
  std::vector<float> normal_;  // random numbers, and some of the first ones again
};

}  // namespace wagonsight
