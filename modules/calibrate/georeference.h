#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "calibrate/solution.h"

namespace wagonsight {

// A ball whose centre is known in the reference frame W (metres) and seen in images (pixels of its
// outline's centre, 0-based).
struct Target {
  std::string id;
  Eigen::Vector3d world = Eigen::Vector3d::Zero();
  struct Sighting {
    std::string imager;
    Eigen::Vector2d pixel;
  };
  std::vector<Sighting> seen;
};

// Reads TARGETS.json (see INTERFACES).
Result<std::vector<Target>> parse_targets(std::string_view json, std::string_view file);

// The least-squares point of rays from two or more imagers, in B, by Gauss-Newton on the
// reprojection error from the midpoint of the rays. The Error says that fewer than two imagers of
// the solution saw the target, or that their rays are all but parallel (under 0.5 degrees).
struct Triangulated {
  Eigen::Vector3d p_B;
  Eigen::Matrix3d covariance;  // m^2, from the solution's sigma0
};
Result<Triangulated> triangulate(const Solution& solution, const Target& target);

// The similarity transform B to W (the paper's equation 7): in closed form (Umeyama 1991), then
// refined with the targets' covariances. Adds it to the solution. Fewer than three targets, or
// targets on one line, are refused.
Result<void> georeference(const std::vector<Target>& targets, Solution& solution);

}  // namespace wagonsight
