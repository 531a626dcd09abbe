#include <algorithm>
#include <bit>
#include <cstdlib>
#include <iterator>

#include "stereo/census_shape.h"
#include "stereo/matcher_kernels.h"
#include "stereo/row_loops.h"

// The specification: written to be read, not to be fast.
namespace wagonsight::stereo_kernels {
namespace {

std::uint8_t saturated(int value) {
  return static_cast<std::uint8_t>(std::min(value, 255));
}

std::size_t offset(int x, int disparities) {
  return static_cast<std::size_t>(x) * static_cast<std::size_t>(disparities);
}

void census_row(const CensusRow& row) {
  const auto neighbours = census_neighbours(row.shape);
  for (int x = 0; x < row.width; ++x) {
    const std::uint16_t centre = row.rows[2][x];
    for (int plane = 0; plane < plane_count(row.shape); ++plane) {
      unsigned bits = 0;
      for (int k = 0; k < 4; ++k) {
        const Neighbour n = neighbours.of[4 * plane + k];
        const int dx = row.mirrored ? -n.dx : n.dx;
        bits = bits << 1 | (row.rows[n.dy + 2][x + dx] < centre ? 1U : 0U);
      }
      row.planes[plane * kPlaneStride + x] = static_cast<std::uint8_t>(bits);
    }
  }
}

void hamming_row(const HammingRow& row) {
  for (int x = 0; x < row.width; ++x) {
    for (int d = 0; d < row.disparities; ++d) {
      int distance = 0;
      for (int plane = 0; plane < row.planes; ++plane) {
        const unsigned left = row.left[plane * kPlaneStride + x];
        const unsigned right = row.right[plane * kPlaneStride + d - x];
        distance += std::popcount(left ^ right);
      }
      row.cost[offset(x, row.disparities) + static_cast<std::size_t>(d)] = saturated(distance);
    }
  }
}

void box_row(const BoxRow& row) {
  for (int x = 0; x < row.width; ++x) {
    for (int d = 0; d < row.disparities; ++d) {
      int sum = 0;
      for (int i = -1; i <= 1; ++i) {
        const std::size_t at = offset(std::clamp(x + i, 0, row.width - 1), row.disparities) +
                               static_cast<std::size_t>(d);
        sum += (row.above[at] + row.here[at] + row.below[at] + 1) / 2;
      }
      row.cost[offset(x, row.disparities) + static_cast<std::size_t>(d)] =
          saturated(row.halved ? (sum + 1) / 2 : sum);
    }
  }
}

// One step of a path for one pixel; returns the least of the new costs. `next` may not be `last`.
std::uint8_t path_step(const std::uint8_t* last, int least, int penalty_1, int penalty_2,
                       const std::uint8_t* cost, int disparities, std::uint8_t* next) {
  const int jump = saturated(least + penalty_2);
  std::uint8_t next_least = 255;
  for (int d = 0; d < disparities; ++d) {
    const int below = d > 0 ? last[d - 1] : 255;
    const int above = d + 1 < disparities ? last[d + 1] : 255;
    const int slope = saturated(std::min(below, above) + penalty_1);
    const int best = std::min({static_cast<int>(last[d]), slope, jump});
    next[d] = saturated(std::max(best - least, 0) + cost[d]);
    next_least = std::min(next_least, next[d]);
  }
  return next_least;
}

// A path along the row keeps its state here, so that nothing is allocated.
struct Horizontal {
  std::uint8_t costs[2][kDisparitiesMax] = {};
  std::uint8_t least = 0;
  int now = 0;

  const std::uint8_t* step(const PathRow& row, int x, std::uint8_t penalty_2) {
    least = path_step(costs[now], least, row.penalty_1, penalty_2,
                      row.cost + offset(x, row.disparities), row.disparities, costs[1 - now]);
    now = 1 - now;
    return costs[now];
  }
};

const std::uint8_t* vertical_step(const PathRow& row, int x, std::uint8_t* next) {
  std::uint8_t* costs = row.vertical + offset(x, row.disparities);
  row.vertical_min[x] = path_step(costs, row.vertical_min[x], row.penalty_1, row.penalty_north[x],
                                  row.cost + offset(x, row.disparities), row.disparities, next);
  std::copy(next, next + row.disparities, costs);
  return costs;
}

void forward_row(const PathRow& row) {
  Horizontal west;
  std::uint8_t next[kDisparitiesMax];
  for (int x = 0; x < row.width; ++x) {
    const std::uint8_t* from_west = west.step(row, x, row.penalty_west[x]);
    const std::uint8_t* from_north = vertical_step(row, x, next);
    for (int d = 0; d < row.disparities; ++d)
      row.sum[offset(x, row.disparities) + static_cast<std::size_t>(d)] =
          saturated(from_west[d] + from_north[d]);
  }
}

// Keeps what the winner search carries from pixel to pixel: the best so far of the right image's
// pixels x - d, by d.
struct Search {
  const WinnerRow& out;
  int disparities;
  std::uint8_t right_cost[kDisparitiesMax + 1];
  std::uint8_t right_choice[kDisparitiesMax + 1] = {};

  Search(const WinnerRow& out_row, int disparity_count)
      : out(out_row), disparities(disparity_count) {
    std::fill(std::begin(right_cost), std::end(right_cost), std::uint8_t{255});
  }

  void pixel(int x, const std::uint8_t* given) {
    std::uint8_t costs[kDisparitiesMax];
    for (int d = 0; d < disparities; ++d) costs[d] = d > out.x_first + x ? 255 : given[d];
    see_from_the_right(x, costs);
    const auto best = static_cast<int>(std::min_element(costs, costs + disparities) - costs);
    const bool interior = best > 0 && best + 1 < disparities;
    out.winner[x] = static_cast<std::uint8_t>(best);
    out.cost[x] = is_unique(costs, best) ? costs[best] : std::uint8_t{255};
    out.cost_below[x] = interior ? costs[best - 1] : costs[best];
    out.cost_above[x] = interior ? costs[best + 1] : costs[best];
  }

  void see_from_the_right(int x, const std::uint8_t* costs) {
    // Going one pixel left, the right image's pixel of lane d is that of lane d + 1 before.
    std::copy(right_cost + 1, right_cost + disparities + 1, right_cost);
    std::copy(right_choice + 1, right_choice + disparities + 1, right_choice);
    right_cost[disparities - 1] = 255;
    right_choice[disparities - 1] = 0;
    for (int d = 0; d < disparities; ++d)
      if (costs[d] <= right_cost[d]) {
        right_cost[d] = costs[d];
        right_choice[d] = static_cast<std::uint8_t>(d);
      }
    out.right_winner[x] = right_choice[0];
  }

  bool is_unique(const std::uint8_t* costs, int best) const {
    if (costs[best] == 255) return false;
    const int limit = out.unique_limit[costs[best]];
    for (int d = 0; d < disparities; ++d)
      if (std::abs(d - best) > 1 && costs[d] < limit) return false;
    return true;
  }

  void finish() {
    for (int d = 1; d < disparities; ++d) out.right_winner[-d] = right_choice[d];
  }
};

void backward_row(const PathRow& row) {
  Horizontal east;
  for (int x = row.width - 1; x >= 0; --x) {
    const std::uint8_t* from_east = east.step(row, x, row.penalty_west[x + 1]);
    std::uint8_t* sum = row.sum + offset(x, row.disparities);
    for (int d = 0; d < row.disparities; ++d) sum[d] = saturated(sum[d] + from_east[d]);
  }
}

void backward_winners(const PathRow& row, const WinnerRow& out) {
  backward_row(row);
  Search search(out, row.disparities);
  for (int x = row.width - 1; x >= 0; --x) search.pixel(x, row.sum + offset(x, row.disparities));
  search.finish();
}

void upward_row(const PathRow& row) {
  std::uint8_t next[kDisparitiesMax];
  for (int x = 0; x < row.width; ++x) vertical_step(row, x, next);
}

void upward_winners(const PathRow& row, const WinnerRow& out) {
  std::uint8_t next[kDisparitiesMax];
  std::uint8_t total[kDisparitiesMax];
  Search search(out, row.disparities);
  for (int x = row.width - 1; x >= 0; --x) {
    const std::uint8_t* from_south = vertical_step(row, x, next);
    const std::uint8_t* sum = row.sum + offset(x, row.disparities);
    for (int d = 0; d < row.disparities; ++d) total[d] = saturated(sum[d] + from_south[d]);
    search.pixel(x, total);
  }
  search.finish();
}

void median_row(const MedianRow& row) {
  for (int x = 0; x < row.width; ++x) {
    std::int16_t window[9];
    for (int k = 0; k < 9; ++k) window[k] = row.rows[k / 3][x + k % 3 - 1];
    std::nth_element(window, window + 4, window + 9);
    row.out[x] = row.rows[1][x] < 0 ? kNoDisparity : window[4];
  }
}

}  // namespace

const Kernels& scalar_kernels() {
  using Loops = RowLoops<void>;
  static constexpr Kernels kernels{
      "scalar",           census_row,           hamming_row, box_row,        forward_row,
      backward_row,       backward_winners,     upward_row,  upward_winners, Loops::texture_row,
      Loops::penalty_row, Loops::disparity_row, median_row};
  return kernels;
}

}  // namespace wagonsight::stereo_kernels
