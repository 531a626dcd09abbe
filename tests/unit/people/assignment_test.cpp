#include "people/assignment.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cmath>
#include <limits>
#include <vector>

namespace wagonsight {
namespace {

// Tries every way to pair; the cheapest sum.
double cheapest(const std::vector<float>& costs, std::size_t rows, std::size_t columns, float alone,
                std::size_t row, std::vector<bool>& used) {
  if (row == rows) return 0;
  double best = alone + cheapest(costs, rows, columns, alone, row + 1, used);
  for (std::size_t column = 0; column < columns; ++column) {
    const float cost = costs[row * columns + column];
    if (used[column] || !(cost < alone)) continue;
    used[column] = true;
    best = std::min(best, cost + cheapest(costs, rows, columns, alone, row + 1, used));
    used[column] = false;
  }
  return best;
}

TEST(Assignment, IsAsCheapAsTheBestOfAllPairings) {
  EXPECT_TRUE(rc::check([] {
    const auto rows = *rc::gen::inRange<std::size_t>(0, 6);
    const auto columns = *rc::gen::inRange<std::size_t>(0, 6);
    const auto alone = static_cast<float>(*rc::gen::inRange(1, 40));
    std::vector<float> costs;
    for (std::size_t i = 0; i < rows * columns; ++i) {
      const int cost = *rc::gen::inRange(0, 60);
      costs.push_back(cost > 50 ? std::numeric_limits<float>::infinity()
                                : static_cast<float>(cost));
    }
    Assignment assignment(6, 6);
    const auto pairs = assignment.solve(costs, rows, columns, alone);
    RC_ASSERT(pairs.size() == rows);
    double sum = 0;
    std::vector<bool> taken(columns, false);
    for (std::size_t row = 0; row < rows; ++row) {
      if (pairs[row] == kUnassigned) {
        sum += alone;
        continue;
      }
      RC_ASSERT(pairs[row] < columns);
      RC_ASSERT(!taken[pairs[row]]);
      taken[pairs[row]] = true;
      RC_ASSERT(costs[row * columns + pairs[row]] < alone);
      sum += costs[row * columns + pairs[row]];
    }
    std::vector<bool> used(columns, false);
    const double best = cheapest(costs, rows, columns, alone, 0, used);
    RC_ASSERT(std::abs(sum - best) < 1e-4);
  }));
}

TEST(Assignment, MakesNoPairThatCostsAsMuchAsStayingAlone) {
  Assignment assignment(1, 1);
  const std::vector<float> costs{5.0F};
  EXPECT_EQ(assignment.solve(costs, 1, 1, 5.0F)[0], kUnassigned);
  EXPECT_EQ(assignment.solve(costs, 1, 1, 5.1F)[0], 0);
}

}  // namespace
}  // namespace wagonsight
