#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "base/result.h"
#include "calibrate/ball_outline.h"
#include "calibrate/solution.h"
#include "frame/image.h"
#include "rig/rig.h"

// Where a target ball's centre is, from its outline in an image or from a Kinect's depth of it.
namespace wagonsight {

// The pixel of the ball's centre. The rays that graze a ball make a circular cone about the ray to
// its centre; the outline's ellipse is that cone's cut with the image and its own centre lies
// farther out. The cone's axis is found from the outline, lens distortion included: unit rays r of
// a circular cone all satisfy r m = 1 for one vector m along the axis.
struct BallCentre {
  Eigen::Vector2d pixel;             // 0-based
  double correction_px = 0;          // from the ellipse's centre
  std::optional<double> distance_m;  // of the ball's centre when its radius was given
};
std::optional<BallCentre> ball_centre(const Camera& camera, const BallOutline& outline,
                                      std::optional<double> radius_m = {});

struct SphereFit {
  Eigen::Vector3d p_S;  // the centre, metres, in the depth camera; readings corrected
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  int readings = 0;
  double rms_m = 0;
};

// Fits a sphere of known radius to the depth about pixel `near`, which must lie on the ball:
// Gauss-Newton on the distances along the readings' rays, readings beyond four sigma (the tripod,
// the wall behind) left out again each round, and those that graze the ball. The Error says that
// nothing was read there or that it is no sphere of that radius.
Result<SphereFit> fit_sphere(const DepthImage& image, const ImagerSolution& imager,
                             const Eigen::Vector2d& near, double radius_m,
                             const DepthNoise& noise = {});

}  // namespace wagonsight
