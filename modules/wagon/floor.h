#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "geometry/transform.h"
#include "wagon/wagon.h"

namespace wagonsight {

// The floor as seen by a sensor of unknown pose.
struct FloorEstimate {
  Rigid X_WS;          // W on the floor straight below the sensor, z up, the sensor looks along +x
  double rms_m = 0;    // of the points on the plane
  double support = 0;  // share of all points that lie on it
};

// Finds the floor in points seen by one sensor (frame S: x right, y down, z forward, metres): of
// the planes whose normal is within `tilt_max` of the image's up direction, the one with next to
// nothing below it and the most support. Deterministic. Nothing when no plane supports at least 2%
// of the points. Allocates; for start-up and learning, not for the data path.
std::optional<FloorEstimate> find_floor(std::span<const Eigen::Vector3f> points_S,
                                        double tilt_max = 1.0);

// A room for a recording that came without one: what of the points (W, with the floor at z = 0) is
// between floor and `height_max`, without the farthest hundredth on each side, and a margin.
// Nothing is looked for above `height_max`. Allocates; for start-up.
Bounds find_inside(std::span<const Eigen::Vector3f> points_W, double height_max = 2.5);

}  // namespace wagonsight
