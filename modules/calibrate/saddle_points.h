#pragma once

#include <Eigen/Core>
#include <vector>

#include "calibrate/corner_snap.h"

namespace wagonsight {

// A place where two dark and two bright sectors meet, as at a chessboard's inner corner.
struct SaddlePoint {  // NOLINT(bugprone-reserved-identifier): its array, copied
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // to about half a pixel
  double contrast = 0;                              // bright minus dark, grey levels
  double bright_angle = 0;  // of the line through the bright sectors, radians, modulo pi
  // Directions (modulo sign) of the two edges that cross, unit vectors.
  Eigen::Vector2d edges[2] = {Eigen::Vector2d::UnitX(), Eigen::Vector2d::UnitY()};
};

// All saddles of an image, strongest first: maxima of the Hessian's saddle strength at three
// scales, so that blurred corners are found too, of which a ring about the point alternates twice
// between dark and bright. Deterministic, allocates.
std::vector<SaddlePoint> find_saddle_points(const GrayImage& image);

}  // namespace wagonsight
