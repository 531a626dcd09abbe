#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace wagonsight {

inline constexpr std::size_t kUnassigned = static_cast<std::size_t>(-1);

// The one-to-one assignment of rows to columns with the largest sum of scores; every row gets a
// column while there are enough, whatever its score. `scores` is row_count x column_count, row by
// row, finite. Returns the column of each row, kUnassigned where columns ran out.
//
// Shortest augmenting paths with potentials (Jonker and Volgenant 1987, "A shortest augmenting path
// algorithm for dense and sparse linear assignment problems"): O(n^2 m) for n <= m. Allocates.
std::vector<std::size_t> assign_best(std::span<const double> scores, std::size_t row_count,
                                     std::size_t column_count);

}  // namespace wagonsight
