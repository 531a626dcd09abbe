#pragma once

#include <Eigen/Core>
#include <optional>

#include "calibrate/corner_snap.h"

namespace wagonsight {

// A ball's outline in an image: an ellipse, which is a circle but for the perspective.
struct BallOutline {
  Eigen::Vector2d centre;        // of the ellipse, pixels, 0-based
  Eigen::Vector2d semi_axes_px;  // longer first
  double angle = 0;              // of the longer axis against the image's x, radians
  double rms_px = 0;             // of the outline's points from the ellipse
  double seen_share = 0;         // of the outline that was found, 0 to 1
};

// Fits the outline of the ball about `near`, which must lie inside of it: along rays from there
// every strong edge is a candidate, the circle that most of them agree on is taken (so that glare
// on the ball and the tripod below it do not matter) and an ellipse is fitted to its points. The
// ellipse's centre is off the projection of the ball's centre by about f (r/d)^2 tan(angle to the
// axis): 0.03 px for a ball of 5 cm across at 3 m
// (`ball_centre` takes it away where the camera is known). Nothing when less than 55% of an outline
// of radius 2.5 px to `radius_max_px` can be seen. Deterministic, allocates.
std::optional<BallOutline> fit_ball_outline(const GrayImage& image, const Eigen::Vector2d& near,
                                            double radius_max_px);

}  // namespace wagonsight
