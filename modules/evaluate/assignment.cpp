#include "evaluate/assignment.h"

#include <limits>

#include "base/check.h"

namespace wagonsight {
namespace {

// The minimisation, rows <= columns. Rows and columns count from 1; 0 is the path's root.
class ShortestPaths {
 public:
  ShortestPaths(std::span<const double> scores, std::size_t rows, std::size_t columns,
                bool transposed)
      : scores_(scores),
        rows_(rows),
        columns_(columns),
        transposed_(transposed),
        row_potential_(rows + 1, 0),
        column_potential_(columns + 1, 0),
        row_of_(columns + 1, 0),
        previous_(columns + 1, 0) {}

  // The row (from 1) of each column (from 1), 0 where it has none.
  const std::vector<std::size_t>& solve() {
    for (std::size_t row = 1; row <= rows_; ++row) augment(row);
    return row_of_;
  }

 private:
  double cost(std::size_t row, std::size_t column) const {
    const std::size_t at =
        transposed_ ? (column - 1) * rows_ + (row - 1) : (row - 1) * columns_ + (column - 1);
    return -scores_[at];
  }

  void augment(std::size_t row) {
    std::vector<double> distance(columns_ + 1, std::numeric_limits<double>::infinity());
    std::vector<bool> done(columns_ + 1, false);
    row_of_[0] = row;
    std::size_t column = 0;
    do {
      column = step(column, distance, done);
    } while (row_of_[column] != 0);
    while (column != 0) {
      row_of_[column] = row_of_[previous_[column]];
      column = previous_[column];
    }
  }

  // Closes `column` and returns the nearest open one.
  std::size_t step(std::size_t column, std::vector<double>& distance, std::vector<bool>& done) {
    done[column] = true;
    const std::size_t row = row_of_[column];
    double nearest = std::numeric_limits<double>::infinity();
    std::size_t next = 0;
    for (std::size_t j = 1; j <= columns_; ++j) {
      if (done[j]) continue;
      const double reduced = cost(row, j) - row_potential_[row] - column_potential_[j];
      if (reduced < distance[j]) {
        distance[j] = reduced;
        previous_[j] = column;
      }
      if (distance[j] < nearest) {
        nearest = distance[j];
        next = j;
      }
    }
    for (std::size_t j = 0; j <= columns_; ++j) {
      if (done[j]) {
        row_potential_[row_of_[j]] += nearest;
        column_potential_[j] -= nearest;
      } else {
        distance[j] -= nearest;
      }
    }
    return next;
  }

  std::span<const double> scores_;
  std::size_t rows_, columns_;
  bool transposed_;
  std::vector<double> row_potential_, column_potential_;
  std::vector<std::size_t> row_of_;    // by column
  std::vector<std::size_t> previous_;  // by column: where the path came from
};

}  // namespace

std::vector<std::size_t> assign_best(std::span<const double> scores, std::size_t row_count,
                                     std::size_t column_count) {
  WS_CHECK(scores.size() == row_count * column_count, "%zu scores for %zu x %zu", scores.size(),
           row_count, column_count);
  std::vector<std::size_t> column_of(row_count, kUnassigned);
  if (scores.empty()) return column_of;
  const bool transposed = row_count > column_count;
  ShortestPaths paths(scores, transposed ? column_count : row_count,
                      transposed ? row_count : column_count, transposed);
  const std::vector<std::size_t>& row_of = paths.solve();
  for (std::size_t column = 1; column < row_of.size(); ++column) {
    const std::size_t row = row_of[column];
    if (row == 0) continue;
    if (transposed) {
      column_of[column - 1] = row - 1;
    } else {
      column_of[row - 1] = column - 1;
    }
  }
  return column_of;
}

}  // namespace wagonsight
