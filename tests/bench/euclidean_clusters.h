#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "base/bounded_vector.h"
#include "foreground/foreground.h"
#include "wagon/wagon.h"

namespace wagonsight::bench {

// Exact Euclidean clusters, as PCL's EuclideanClusterExtraction defines them: points that are
// joined by steps of at most `tolerance_m`. Cells are so small that points of one cell always
// belong together; each pair of near cells that is not joined yet is then tried until two of its
// points are near enough, nearest cells first, so that few pairs are left for the far ones.
class EuclideanClusters {
 public:
  EuclideanClusters(const Bounds& inside, double tolerance_m, std::size_t points_max);
  // The number of clusters of at least `points_min` points. Never allocates.
  std::size_t count(std::span<const ForegroundPoint> points, std::uint32_t points_min);

 private:
  struct Cell {
    std::uint32_t first = 0, parent = 0;  // of its points; of its cluster
    std::uint32_t points = 0;
    std::uint32_t at = 0;       // in cell_at_
    std::uint32_t bits_at = 0;  // the byte of occupied_ that holds the bit two to its left
    std::uint32_t shift = 0;    // and which of its bits that is
  };
  std::uint32_t root(std::uint32_t cell);
  // Tries all pairs of cells that are (dx, dy, dz) apart; dx from the lowest to the highest bit of
  // five that is set in `offsets`, which stand for -2 to 2.
  void join_row(std::span<const ForegroundPoint> points, int dy, int dz, unsigned offsets);
  void fill(std::span<const ForegroundPoint> points);
  void join(std::span<const ForegroundPoint> points, std::uint32_t a, std::uint32_t b);

  Eigen::Vector3f min_;
  float per_cell_, tolerance_squared_;
  int size_[3];
  std::unique_ptr<std::uint32_t[]> cell_at_;  // index + 1 of the cell there, 0: none
  std::unique_ptr<std::uint8_t[]> occupied_;  // a bit a cell, rows apart
  std::size_t row_bytes_;
  BoundedVector<Cell> cells_;
  BoundedVector<std::uint32_t> next_point_;  // the next point of the same cell
};

}  // namespace wagonsight::bench
