#pragma once

#include <cmath>

// Distances on the floor, metres. Private to this module's sources.
namespace wagonsight {

// Nothing of one who lies on the floor is higher.
inline constexpr float kLyingTop = 0.65F;

// Nobody rises so much between two sights; what is higher is somebody else.
inline constexpr float kRisesAtOnce = 0.4F;
// Head and feet of one who lies are up to this far apart.
inline constexpr double kLyingReach = 1.0;

inline double square(double value) {
  return value * value;
}

inline double distance_between(double ax, double ay, double bx, double by) {
  return std::sqrt(square(ax - bx) + square(ay - by));
}

}  // namespace wagonsight
