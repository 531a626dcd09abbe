#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/bounded_vector.h"
#include "simulate/kinect_optics.h"
#include "simulate/noise_field.h"
#include "simulate/world.h"

namespace wagonsight {

// One simulated Kinect: turns the world at an instant into raw depth. The still wagon is rendered
// once for every light and pose; passengers, luggage and door leaves are cast into a copy of it,
// the projector's shadow and the noise follow. Allocates only when made. One thread.
class KinectModel {
 public:
  KinectModel(const Scene& scene, std::size_t sensor, std::uint64_t seed);

  // Raw depth at an instant, millimetres, 640 x 480; `number` keys the noise of the frame.
  void render(World& world, HostTime instant, std::uint32_t number, std::span<std::uint16_t> depth);

  // Of the last render, for tests and pictures: whose pixel it is without any noise (0 the still
  // wagon, passenger index + 1, or minus that for luggage), and a shaded grey picture.
  std::int32_t tag_at(int u, int v) const;
  void picture(std::span<std::uint8_t> grey) const;

  const Camera& camera() const { return optics_.raster().camera(); }

 private:
  struct Still {
    std::size_t light = 0;
    double moved = 0;
    StillView view;
  };
  static constexpr std::size_t kPartsMax = 8192;  // 128 passengers with luggage
  static constexpr int kWidth = 640, kHeight = 480;
  static constexpr int kStride = kWidth + 2 * kMargin;
  static constexpr int kRows = kHeight + 2 * kMargin;

  double moved_at(double seconds) const;
  Rigid pose_moved(double metres) const;
  const Still& still_at(double seconds) const;
  void gather(World& world, HostTime instant);
  void add(const Parts& parts, const Rigid& X_SW, const SceneLight& light);
  void draw_parts();
  void score_parts();
  void add_noise(std::uint32_t number, std::span<std::uint16_t> depth);
  void look_aside(int v);
  void quantise(int v, std::span<std::uint16_t> out);
  std::size_t at(int u, int v) const {
    return static_cast<std::size_t>((v + kMargin) * kStride + u + kMargin);
  }

  const Scene* scene_;
  std::size_t sensor_;
  std::uint64_t seed_;
  float noise_;
  KinectOptics optics_;
  std::vector<Still> stills_;
  BoundedVector<PreparedPart> parts_;
  BoundedVector<float> part_score_, part_foreign_;  // by part
  std::array<float, 256> incidence_score_{};        // what a cosine of i / 255 takes from a score
  std::vector<float> inverse_depth_, score_;        // kRows x kStride
  std::vector<std::int32_t> part_;                  // likewise; index into parts_ or -1
  DrawRect changed_;                                // where parts were drawn
  NoiseField depth_noise_, score_noise_, shift_u_, shift_v_;
  std::array<float, kWidth> row_depth_{}, row_score_{};
  std::vector<std::uint16_t> millimetres_;  // by level
};

}  // namespace wagonsight
