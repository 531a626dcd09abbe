#include "wagon/wagon.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

constexpr double kDoorway = 0.6;    // metres before and behind a threshold
constexpr double kDoorFrame = 0.1;  // a shoulder's place beside the opening

// Signed distance from a door's threshold, positive towards the middle of the wagon, when the
// place lies in the door's way; kDoorway otherwise.
double before_threshold(const Door& door, const Bounds& inside, const Eigen::Vector2d& place) {
  const Eigen::Vector2d from(door.from[0], door.from[1]);
  const Eigen::Vector2d to(door.to[0], door.to[1]);
  const double width = (to - from).norm();
  if (width <= 0) return kDoorway;
  const Eigen::Vector2d along = (to - from) / width;
  Eigen::Vector2d inward(-along.y(), along.x());
  const Eigen::Vector2d middle = 0.5 * (inside.min + inside.max).head<2>();
  if (inward.dot(middle - from) < 0) inward = -inward;
  const double sideways = along.dot(place - from);
  if (sideways < -kDoorFrame || sideways > width + kDoorFrame) return kDoorway;
  const double before = inward.dot(place - from);
  return before > -kDoorway ? std::min(before, kDoorway) : kDoorway;
}

}  // namespace

bool contains(const Zone& zone, const std::array<double, 2>& position) {
  bool inside = false;
  const std::size_t count = zone.polygon.size();
  for (std::size_t i = 0, before = count - 1; i < count; before = i++) {
    const auto& a = zone.polygon[i];
    const auto& b = zone.polygon[before];
    if ((a[1] > position[1]) == (b[1] > position[1])) continue;
    const double crossing = a[0] + (position[1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1]);
    if (position[0] < crossing) inside = !inside;
  }
  return inside;
}

DepthInside depth_inside(const Wagon& wagon, const std::array<double, 2>& position) {
  const Eigen::Vector2d place(position[0], position[1]);
  DepthInside depth;
  depth.m = std::min((place - wagon.inside.min.head<2>()).minCoeff(),
                     (wagon.inside.max.head<2>() - place).minCoeff());
  for (std::size_t i = 0; i < wagon.doors.size(); ++i) {
    const double before = before_threshold(wagon.doors[i], wagon.inside, place);
    if (before < kDoorway) return {before, static_cast<int>(i)};
  }
  return depth;
}

}  // namespace wagonsight
