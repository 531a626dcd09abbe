#pragma once

#include <cstddef>

#include "stereo/matcher_kernels.h"

// Which neighbours the census compares, in the order of its bits.
namespace wagonsight::stereo_kernels {

struct Neighbour {
  int dx;
  int dy;
};

struct NeighbourList {
  Neighbour of[4 * kPlanesMax];
};

// The first 4 * plane_count(shape) entries count.
constexpr NeighbourList census_neighbours(CensusShape shape) {
  const int reach = shape == CensusShape::kNarrow ? 2 : 3;
  NeighbourList neighbours{};
  std::size_t count = 0;
  for (int dy = -2; dy <= 2; ++dy)
    for (int dx = -reach; dx <= reach; ++dx) {
      const bool is_centre = dx == 0 && dy == 0;
      const bool is_end = dy == 0 && (dx == 3 || dx == -3);
      if (!is_centre && !is_end) neighbours.of[count++] = {dx, dy};
    }
  return neighbours;
}

}  // namespace wagonsight::stereo_kernels
