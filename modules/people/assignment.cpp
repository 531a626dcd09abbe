#include "people/assignment.h"

#include <limits>

#include "base/check.h"

namespace wagonsight {

Assignment::Assignment(std::size_t rows_max, std::size_t columns_max)
    : rows_max_(rows_max),
      columns_max_(columns_max),
      row_price_(rows_max + 1),
      column_price_(columns_max + rows_max + 1),
      shortest_(columns_max + rows_max + 1),
      row_of_(columns_max + rows_max + 1),
      way_(columns_max + rows_max + 1),
      used_(columns_max + rows_max + 1),
      result_(rows_max) {}

std::span<const std::uint16_t> Assignment::solve(std::span<const float> costs, std::size_t rows,
                                                 std::size_t columns, float alone_cost) {
  WS_CHECK(rows <= rows_max_ && columns <= columns_max_ && costs.size() >= rows * columns,
           "%zu x %zu of %zu x %zu, %zu costs", rows, columns, rows_max_, columns_max_,
           costs.size());
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  const double forbidden = 1e6 + 1e3 * static_cast<double>(alone_cost);
  const std::size_t all = columns + rows;
  const auto cost = [&](std::size_t row, std::size_t column) {  // 1-based
    if (column > columns)
      return column - columns == row ? static_cast<double>(alone_cost) : forbidden;
    const float c = costs[(row - 1) * columns + column - 1];
    return c < alone_cost ? static_cast<double>(c) : forbidden;
  };
  row_price_.resize(rows + 1);
  column_price_.resize(all + 1);
  shortest_.resize(all + 1);
  row_of_.resize(all + 1);
  way_.resize(all + 1);
  used_.resize(all + 1);
  for (double& price : row_price_) price = 0;
  for (double& price : column_price_) price = 0;
  for (std::uint32_t& row : row_of_) row = 0;

  for (std::uint32_t row = 1; row <= rows; ++row) {
    row_of_[0] = row;
    for (double& value : shortest_) value = kInfinite;
    for (std::uint8_t& flag : used_) flag = 0;
    std::uint32_t column = 0;
    do {
      used_[column] = 1;
      const std::uint32_t from = row_of_[column];
      double step = kInfinite;
      std::uint32_t next = 0;
      for (std::uint32_t j = 1; j <= all; ++j) {
        if (used_[j] != 0) continue;
        const double reduced = cost(from, j) - row_price_[from] - column_price_[j];
        if (reduced < shortest_[j]) {
          shortest_[j] = reduced;
          way_[j] = column;
        }
        if (shortest_[j] < step) {
          step = shortest_[j];
          next = j;
        }
      }
      for (std::uint32_t j = 0; j <= all; ++j) {
        if (used_[j] != 0) {
          row_price_[row_of_[j]] += step;
          column_price_[j] -= step;
        } else {
          shortest_[j] -= step;
        }
      }
      column = next;
    } while (row_of_[column] != 0);
    while (column != 0) {
      row_of_[column] = row_of_[way_[column]];
      column = way_[column];
    }
  }
  result_.resize(rows);
  for (std::uint16_t& column : result_) column = kUnassigned;
  for (std::uint32_t j = 1; j <= columns; ++j)
    if (row_of_[j] != 0 && costs[(row_of_[j] - 1) * columns + j - 1] < alone_cost)
      result_[row_of_[j] - 1] = static_cast<std::uint16_t>(j - 1);
  return result_.span();
}

}  // namespace wagonsight
