#pragma once

#include <algorithm>
#include <cmath>

#include "foreground/sensor_view.h"
#include "voxel/bit_octree.h"

namespace wagonsight {

// A ray along a plane of the grid, tilted by nothing that matters so that it can be divided by.
inline Eigen::Vector3f steep(Eigen::Vector3f ray) {
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(ray[axis]) < 1e-6F) ray[axis] = 1e-6F;
  }
  return ray;
}

// Walks a pixel's ray through the leaves of an octree from depth z_from to z_to and calls
// visit(z_enter, z_leave) for every leaf that is set, nearest first, until it returns false.
// Amanatides and Woo 1987, on the octree's levels: an empty node is one step.
template <class Visit>
void walk_ray(const SensorView& view, const BitOctree& octree, std::size_t pixel, float z_from,
              float z_to, Visit&& visit) {
  const LeafGrid& grid = octree.grid();
  const Eigen::Vector3f origin = view.origin_grid();
  const Eigen::Vector3f ray = steep(view.ray_grid(pixel));
  Eigen::Vector3f per_ray;
  float enter = z_from, leave = z_to;
  for (int axis = 0; axis < 3; ++axis) {
    per_ray[axis] = 1.0F / ray[axis];
    const float a = -origin[axis] * per_ray[axis];
    const float b =
        (static_cast<float>(grid.leaves()[static_cast<std::size_t>(axis)]) - origin[axis]) *
        per_ray[axis];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  if (!(enter < leave)) return;
  LeafIndex cell;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<Eigen::Index>(axis);
    cell[axis] = std::clamp(static_cast<int>(std::floor(origin[a] + enter * ray[a])), 0,
                            grid.leaves()[axis] - 1);
  }
  float z = enter;
  while (z < leave) {
    const LeafAddress address = grid.address(cell);
    const int size = octree.empty_node(address);
    // Where the ray leaves this node: the nearest of its three far faces.
    std::size_t out_axis = 0;
    float out = INFINITY;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<Eigen::Index>(axis);
      const int corner = cell[axis] & ~(size - 1);
      const int face = ray[a] > 0 ? corner + size : corner;
      const float at = (static_cast<float>(face) - origin[a]) * per_ray[a];
      if (at < out) {
        out = at;
        out_axis = axis;
      }
    }
    out = std::max(out, z);
    if (size == 1 && octree.contains(address) && !visit(z, std::min(out, leave))) return;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<Eigen::Index>(axis);
      const int corner = cell[axis] & ~(size - 1);
      if (axis == out_axis) {
        cell[axis] = ray[a] > 0 ? corner + size : corner - 1;
      } else if (size > 1) {
        cell[axis] = std::clamp(static_cast<int>(std::floor(origin[a] + out * ray[a])), corner,
                                corner + size - 1);
      }
    }
    if (!grid.contains(cell)) return;
    z = out;
  }
}

}  // namespace wagonsight
