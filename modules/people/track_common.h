#pragma once

#include <cmath>

#include "people/track.h"

// What the sources of the tracker share. Private to them.
namespace wagonsight {

inline constexpr double kWellKnown = 2.0;  // seconds
// Metres: one who leans on a wall has more than that of body between.
inline constexpr double kThreshold = 0.10;
inline constexpr double kHeightKnown = 1.0;  // seconds of standing free

inline double distance(const std::array<double, 2>& a, const std::array<double, 2>& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1]);
}

inline bool height_is_known(const Track& track) {
  return track.upright_s > kHeightKnown;
}

}  // namespace wagonsight
