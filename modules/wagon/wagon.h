#pragma once

#include <Eigen/Core>
#include <array>

#include "base/capacities.h"
#include "base/fixed_string.h"
#include "base/fixed_vector.h"

// The room that is watched, in world coordinates (W: origin at a floor corner or below the sensor,
// x along the wagon, z up, metres). Drawn by a person in the settings, or found in a recording.
namespace wagonsight {

struct Bounds {  // axis-aligned
  Eigen::Vector3d min = Eigen::Vector3d::Zero();
  Eigen::Vector3d max = Eigen::Vector3d::Zero();

  bool contains(const Eigen::Vector3d& p) const {
    return (p.array() >= min.array()).all() && (p.array() <= max.array()).all();
  }
};

struct Zone {
  Name name;
  FixedVector<std::array<double, 2>, kZoneCornersMax> polygon;  // simple, on the floor
  int capacity = 0;                                             // people; 0: not stated
};
struct Seat {
  Name name;
  std::array<double, 2> position{};  // centre of the seat on the floor
  double yaw = 0;                    // direction a sitter looks, radians from +x
  double width = 0.5;
};
struct Door {
  Name name;
  std::array<double, 2> from{}, to{};  // the threshold
};
struct MaskVolume {  // depth that ends here means nothing: a window, a screen, a mirror
  Name name;
  Bounds bounds;
};

struct Wagon {
  Bounds inside;  // people are only looked for in here; the floor is its z = 0 plane
  FixedVector<Zone, kZonesMax> zones;
  FixedVector<Seat, kSeatsMax> seats;
  FixedVector<Door, kDoorsMax> doors;
  FixedVector<MaskVolume, kMasksMax> masks;
};

// Even-odd rule; a point on the boundary may count either way.
bool contains(const Zone& zone, const std::array<double, 2>& position);

// How far inside a place on the floor is: metres to the nearest side, negative beyond it. In a
// doorway the side is the door's threshold, which is where people come in and go out.
struct DepthInside {
  double m = 0;
  int door = -1;  // index of the door in whose way the place lies, -1: none
};
DepthInside depth_inside(const Wagon& wagon, const std::array<double, 2>& position);

}  // namespace wagonsight
