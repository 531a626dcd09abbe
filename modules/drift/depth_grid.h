#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "frame/image.h"

namespace wagonsight {

// Every fifth pixel of every fifth row: enough to watch a wall by, and little to keep.
struct DepthGrid {
  static constexpr int kStep = 5;
  int width = 0, height = 0;  // of the image

  int columns() const { return (width + kStep - 1) / kStep; }
  int rows() const { return (height + kStep - 1) / kStep; }
  std::size_t size() const {
    return static_cast<std::size_t>(columns()) * static_cast<std::size_t>(rows());
  }
  // Index into the image of a grid's cell.
  std::size_t pixel(std::size_t cell) const {
    const auto across = static_cast<std::size_t>(columns());
    return cell / across * kStep * static_cast<std::size_t>(width) + cell % across * kStep;
  }
};

// Copies the grid's readings. `out` has grid.size() of them. Allocates nothing; for the data path.
void sample(const DepthGrid& grid, DepthImage image, std::span<std::uint16_t> out);

}  // namespace wagonsight
