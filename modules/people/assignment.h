#pragma once

#include <cstdint>
#include <span>

#include "base/bounded_vector.h"

namespace wagonsight {

inline constexpr std::uint16_t kUnassigned = UINT16_MAX;

// The cheapest pairing of rows with columns where a row may also stay alone: minimises the sum of
// the costs of the pairs plus `alone_cost` for every row without one. (Shortest augmenting paths,
// Jonker and Volgenant 1987; O(rows^2 * columns).) Pairs that cost alone_cost or more are never
// made. Allocates only in the constructor; deterministic.
class Assignment {
 public:
  Assignment(std::size_t rows_max, std::size_t columns_max);

  // `costs` row by row, rows * columns of them, finite or infinite, none negative. The result, by
  // row, is the column or kUnassigned; valid until the next call.
  std::span<const std::uint16_t> solve(std::span<const float> costs, std::size_t rows,
                                       std::size_t columns, float alone_cost);

 private:
  std::size_t rows_max_, columns_max_;
  // Every row has one column of its own after the real ones: to stay alone.
  BoundedVector<double> row_price_, column_price_, shortest_;
  BoundedVector<std::uint32_t> row_of_;  // by column, 1-based rows, 0: free
  BoundedVector<std::uint32_t> way_;
  BoundedVector<std::uint8_t> used_;
  BoundedVector<std::uint16_t> result_;
};

}  // namespace wagonsight
