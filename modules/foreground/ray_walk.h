#pragma once

#include <algorithm>
#include <array>
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

// std::floor() of what fits an int, which is a call without SSE 4.1.
inline int floor_to_int(float value) {
  const int whole = static_cast<int>(value);
  return whole - (static_cast<float>(whole) > value ? 1 : 0);
}

// Walks a pixel's ray through the leaves of an octree from depth z_from to z_to and calls
// visit(z_enter, z_leave) for every leaf that is set, nearest first, until it returns false.
// Amanatides and Woo 1987, on the octree's levels: an empty node is one step.
template <class Visit>
void walk_ray(const SensorView& view, const BitOctree& octree, std::size_t pixel, float z_from,
              float z_to, Visit&& visit) {
  const LeafGrid& grid = octree.grid();
  const Eigen::Vector3f origin_grid = view.origin_grid();
  const Eigen::Vector3f ray_grid = steep(view.ray_grid(pixel));
  // Plain arrays: they stay in registers, and the loops over the axes are unrolled.
  std::array<float, 3> origin, ray, per_ray;
  std::array<int, 3> ahead;  // 1: the ray leaves a node by the face with the larger coordinate
  float enter = z_from, leave = z_to;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    origin[axis] = origin_grid[static_cast<Eigen::Index>(axis)];
    ray[axis] = ray_grid[static_cast<Eigen::Index>(axis)];
    per_ray[axis] = 1.0F / ray[axis];
    ahead[axis] = ray[axis] > 0 ? 1 : 0;
    const float a = -origin[axis] * per_ray[axis];
    const float b = (static_cast<float>(grid.leaves()[axis]) - origin[axis]) * per_ray[axis];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  if (!(enter < leave)) return;
  LeafIndex cell;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    cell[axis] =
        std::clamp(floor_to_int(origin[axis] + enter * ray[axis]), 0, grid.leaves()[axis] - 1);
  }
  float z = enter;
  while (z < leave) {
    const LeafAddress address = grid.address(cell);
    const int size = octree.empty_node(address);
    // Where the ray leaves this node: the nearest of its three far faces.
    std::array<float, 3> at;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const int face = (cell[axis] & ~(size - 1)) + (ahead[axis] != 0 ? size : 0);
      at[axis] = (static_cast<float>(face) - origin[axis]) * per_ray[axis];
    }
    std::size_t out_axis = at[1] < at[0] ? 1 : 0;
    if (at[2] < at[out_axis]) out_axis = 2;
    const float out = std::max(at[out_axis], z);
    if (size == 1) {
      if (octree.contains(address) && !visit(z, std::min(out, leave))) return;
      cell[out_axis] += 2 * ahead[out_axis] - 1;
    } else {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const int corner = cell[axis] & ~(size - 1);
        if (axis == out_axis) {
          cell[axis] = ahead[axis] != 0 ? corner + size : corner - 1;
        } else {
          cell[axis] =
              std::clamp(floor_to_int(origin[axis] + out * ray[axis]), corner, corner + size - 1);
        }
      }
    }
    if (!grid.contains(cell)) return;
    z = out;
  }
}

}  // namespace wagonsight
