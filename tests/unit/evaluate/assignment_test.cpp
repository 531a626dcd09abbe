#include "evaluate/assignment.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <numeric>
#include <set>

namespace wagonsight {
namespace {

double sum_of(const std::vector<double>& scores, std::size_t columns,
              const std::vector<std::size_t>& column_of) {
  double sum = 0;
  for (std::size_t row = 0; row < column_of.size(); ++row) {
    if (column_of[row] != kUnassigned) sum += scores[row * columns + column_of[row]];
  }
  return sum;
}

// The oracle: every way to give rows columns, by permuting the larger side.
double best_sum_by_trying_all(const std::vector<double>& scores, std::size_t rows,
                              std::size_t columns) {
  std::vector<std::size_t> order(std::max(rows, columns));
  std::iota(order.begin(), order.end(), 0U);
  double best = -1e300;
  do {
    double sum = 0;
    for (std::size_t i = 0; i < std::min(rows, columns); ++i) {
      sum += rows <= columns ? scores[i * columns + order[i]] : scores[order[i] * columns + i];
    }
    best = std::max(best, sum);
  } while (std::next_permutation(order.begin(), order.end()));
  return best;
}

TEST(AssignBest, TakesTheLargestSumAndNotTheLargestScore) {
  // 9 + 1 is less than 8 + 7.
  EXPECT_EQ(assign_best(std::vector<double>{9, 8, 7, 1}, 2, 2), (std::vector<std::size_t>{1, 0}));
}

TEST(AssignBest, LeavesRowsOverWhenColumnsRunOut) {
  EXPECT_EQ(assign_best(std::vector<double>{1, 5, 3}, 3, 1),
            (std::vector<std::size_t>{kUnassigned, 0, kUnassigned}));
}

TEST(AssignBest, HasNothingToDoWithoutRowsOrColumns) {
  EXPECT_TRUE(assign_best({}, 0, 3).empty());
  EXPECT_EQ(assign_best({}, 2, 0), (std::vector<std::size_t>{kUnassigned, kUnassigned}));
}

RC_GTEST_PROP(AssignBest, EqualsTryingAll, ()) {
  const auto rows = *rc::gen::inRange<std::size_t>(1, 7);
  const auto columns = *rc::gen::inRange<std::size_t>(1, 7);
  const auto raw = *rc::gen::container<std::vector<int>>(rows * columns, rc::gen::inRange(-8, 9));
  const std::vector<double> scores(raw.begin(), raw.end());
  const std::vector<std::size_t> column_of = assign_best(scores, rows, columns);
  std::set<std::size_t> used;
  for (const std::size_t column : column_of) {
    if (column != kUnassigned) RC_ASSERT(used.insert(column).second);
  }
  RC_ASSERT(used.size() == std::min(rows, columns));
  RC_ASSERT(sum_of(scores, columns, column_of) == best_sum_by_trying_all(scores, rows, columns));
}

}  // namespace
}  // namespace wagonsight
