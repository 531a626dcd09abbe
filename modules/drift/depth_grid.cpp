#include "drift/depth_grid.h"

namespace wagonsight {

void sample(const DepthGrid& grid, DepthImage image, std::span<std::uint16_t> out) {
  std::size_t cell = 0;
  for (int v = 0; v < grid.height; v += DepthGrid::kStep)
    for (int u = 0; u < grid.width; u += DepthGrid::kStep) out[cell++] = image.at(u, v);
}

}  // namespace wagonsight
