#pragma once

#include <array>
#include <span>

#include "base/fixed_vector.h"
#include "fusion/fused_cloud.h"

namespace wagonsight {

struct HeadMode {  // a place where surface of the uppermost band is densest
  float x = 0, y = 0;
  float weight = 0;
  float top = 9;  // nothing higher belongs to it, metres
};

// Tells heads apart that noise has blurred into one hill: a density of the points of the uppermost
// band over a patch of floor, in which exact points count more than noisy ones, smoothed to half
// the width of a head. Fixed memory.
class HeadModes {
 public:
  // Starts a patch of 2.5 m around a place, world frame, metres.
  void clear(float centre_x, float centre_y);
  void add(const FusedPoint& point);
  // The places of the heads, densest first: maxima with a third of the highest density at least,
  // half a head apart at least, between which the density falls below `gap` of the fainter one.
  std::span<const HeadMode> find(float gap);

 private:
  static constexpr int kSide = 64;
  static constexpr float kCell = 0.04F;  // metres
  using Grid = std::array<float, static_cast<std::size_t>(kSide) * kSide>;

  void smooth();
  float density_between(const HeadMode& a, const HeadMode& b) const;
  float at(int column, int row) const;

  float min_x_ = 0, min_y_ = 0;
  Grid density_{}, scratch_{};
  FixedVector<HeadMode, 16> modes_;
};

}  // namespace wagonsight
