#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "calibrate/ball_outline.h"
#include "calibrate/markers.h"
#include "calibrate/solution.h"

namespace wagonsight {

// A ball whose centre is known in the reference frame W (metres) and seen in images (pixels of its
// centre, 0-based) or in a Kinect's depth (a sphere fitted to it).
struct Target {
  std::string id;
  std::optional<Eigen::Vector3d> world;  // absent: to be taken from the tracker's markers
  std::string marker;                    // its name there; the target's id when empty
  std::optional<double> radius_m;        // of the ball
  struct Sighting {
    std::string imager;
    Eigen::Vector2d pixel;
    std::string image;                   // file, as in the observations; may be empty
    std::optional<BallOutline> outline;  // where one was fitted
  };
  std::vector<Sighting> seen;
  struct Sphere {
    std::string imager;
    Eigen::Vector3d p_S;  // in the sensor's depth camera, metres, corrected readings
    double sigma_m = 0.003;
  };
  std::vector<Sphere> spheres;
};

// Reads TARGETS.json (see INTERFACES).
Result<std::vector<Target>> parse_targets(std::string_view json, std::string_view file);

// Gives the targets without reference coordinates those of their markers. The Error names a target
// whose marker the tracker did not see.
Result<void> take_markers(const Markers& markers, std::vector<Target>& targets);

// The least-squares point of rays from two or more imagers and of spheres in depth, in B, by
// Gauss-Newton on the reprojection error from the midpoint of the rays. The Error says that fewer
// than two imagers of the solution saw the target and none in depth, or that the rays are all but
// parallel (under 0.5 degrees).
struct Triangulated {
  Eigen::Vector3d p_B;
  Eigen::Matrix3d covariance;  // m^2, from the solution's sigma0 alone
  // d p_B / d X_BS of all imagers, six columns each as in Solution::joint_covariance: what the
  // cameras' own errors do to the point.
  Eigen::Matrix3Xd by_imagers;
};
Result<Triangulated> triangulate(const Solution& solution, const Target& target);

// The similarity transform B to W (the paper's equation 7): in closed form (Umeyama 1991), then
// refined with the targets' joint covariance, which holds the noise of their sightings, the
// cameras' covariance and 0.5 mm of the reference. Adds it to the solution. Fewer than three
// targets, or targets on one line, are refused.
Result<void> georeference(const std::vector<Target>& targets, Solution& solution);

}  // namespace wagonsight
