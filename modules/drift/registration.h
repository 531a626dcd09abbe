#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "drift/static_surface.h"
#include "rig/rig.h"

namespace wagonsight {

// Where a sensor stands now, in the frame S it had on the day of calibration (x right, y down, z
// forward as it looks): p_S = exp(turn) * scale * p_now + shift.
struct SensorMotion {
  bool known = false;  // false: too little of the wagon was recognised
  Eigen::Vector3d shift_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d turn_rad = Eigen::Vector3d::Zero();  // rotation vector
  double scale = 1;                                    // depth of then over depth of now
  double sigma_shift_m = 0, sigma_turn_rad = 0, sigma_scale = 0;
  int points = 0;            // that were recognised
  double fitting_share = 0;  // of the points that were seen
  // Directions that this view of the wagon tells badly or not at all, in words.
  std::vector<std::string> vague;
};

// The motion that brings `now_S` onto the surface: point to plane (Chen and Medioni 1992), robust
// (Tukey's weights on the median deviation), points by the `noise` at their depth, with the prior
// that the sensor stands within 2 cm of its place. In the space of the normal matrix's
// eigenvectors, directions that are known to less than 3 mm (2 m away for turns and scale) are
// named in `vague`; those known to less than 8 mm are left at zero. The sigmas are along the shift
// and about the turn. Allocates.
SensorMotion register_onto(const StaticSurface& surface, std::span<const Eigen::Vector3f> now_S,
                           const DepthNoise& noise);

}  // namespace wagonsight
