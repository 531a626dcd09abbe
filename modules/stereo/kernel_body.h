#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>

#include "stereo/census_shape.h"
#include "stereo/matcher_kernels.h"
#include "stereo/row_loops.h"

// The kernels over an instruction set S (kernels_avx2.cpp, kernels_neon.cpp), with N vectors of 32
// disparities held in registers. Nothing here calls an inline function of another header: compiled
// with an instruction set's flags, the linker could hand such a copy to code that runs everywhere.
namespace wagonsight::stereo_kernels {

template <class S, std::size_t N>
struct Body {
  using Bytes = typename S::Bytes;
  static constexpr std::size_t kVector = kLanes;
  static constexpr std::size_t kBytes = N * kVector;  // of a pixel's costs
  static constexpr int kDisparities = static_cast<int>(kBytes);

  // N vectors that stay in registers.
  struct Costs {
    Bytes v[N];
  };

  static Costs load(const std::uint8_t* p) {
    Costs costs;
    for (std::size_t n = 0; n < N; ++n) costs.v[n] = S::load(p + n * kVector);
    return costs;
  }
  static void store(std::uint8_t* p, const Costs& costs) {
    for (std::size_t n = 0; n < N; ++n) S::store(p + n * kVector, costs.v[n]);
  }
  static Costs splat(std::uint8_t value) {
    Costs costs;
    for (std::size_t n = 0; n < N; ++n) costs.v[n] = S::splat(value);
    return costs;
  }
  static Costs add_saturated(const Costs& a, const Costs& b) {
    Costs sum;
    for (std::size_t n = 0; n < N; ++n) sum.v[n] = S::add_saturated(a.v[n], b.v[n]);
    return sum;
  }
  static Bytes least(const Costs& costs) {
    Bytes m = costs.v[0];
    for (std::size_t n = 1; n < N; ++n) m = S::least(m, costs.v[n]);
    return S::least_everywhere(m);
  }

  template <int Planes>
  static void hamming_row(const HammingRow& row) {
    for (int x = 0; x < row.width; ++x) {
      Costs distance = splat(0);
      for (int plane = 0; plane < Planes; ++plane) {
        const Bytes left = S::splat(row.left[plane * kPlaneStride + x]);
        const std::uint8_t* right = row.right + plane * kPlaneStride - x;
        for (std::size_t n = 0; n < N; ++n)
          distance.v[n] = S::add(distance.v[n],
                                 S::bit_count(S::exclusive_or(left, S::load(right + n * kVector))));
      }
      store(row.cost + static_cast<std::size_t>(x) * kBytes, distance);
    }
  }
  static void hamming(const HammingRow& row) {
    row.planes == plane_count(CensusShape::kNarrow) ? hamming_row<6>(row) : hamming_row<8>(row);
  }

  // Half the sum of a column of three costs, rounded up.
  static Costs column(const BoxRow& row, int x) {
    const std::size_t at = static_cast<std::size_t>(x) * kBytes;
    Costs half;
    for (std::size_t n = 0; n < N; ++n) {
      const std::size_t lane = at + n * kVector;
      const Bytes sum = S::add(S::add(S::load(row.above + lane), S::load(row.here + lane)),
                               S::load(row.below + lane));
      half.v[n] = S::average(sum, S::splat(0));
    }
    return half;
  }
  static void box_row(const BoxRow& row) {
    row.halved ? box_row_as<true>(row) : box_row_as<false>(row);
  }
  template <bool Halved>
  static void box_row_as(const BoxRow& row) {
    Costs here = column(row, 0), west = here;
    for (int x = 0; x < row.width; ++x) {
      const Costs east = x + 1 < row.width ? column(row, x + 1) : here;
      Costs sum = add_saturated(add_saturated(west, here), east);
      for (std::size_t n = 0; Halved && n < N; ++n) sum.v[n] = S::average(sum.v[n], S::splat(0));
      store(row.cost + static_cast<std::size_t>(x) * kBytes, sum);
      west = here;
      here = east;
    }
  }

  // Advances a path by one pixel; `least` is in every lane.
  struct Path {
    Costs costs = splat(0);
    Bytes least = S::splat(0);

    void step(const std::uint8_t* cost, std::uint8_t penalty_1, std::uint8_t penalty_2) {
      const Bytes p1 = S::splat(penalty_1);
      const Bytes jump = S::add_saturated(least, S::splat(penalty_2));
      const Bytes border = S::splat(255);
      Costs next;
      for (std::size_t n = 0; n < N; ++n) {
        const Bytes below = S::shift_up(n > 0 ? costs.v[n > 0 ? n - 1 : 0] : border, costs.v[n]);
        const Bytes above =
            S::shift_down(costs.v[n], n + 1 < N ? costs.v[n + 1 < N ? n + 1 : n] : border);
        const Bytes slope = S::add_saturated(S::least(below, above), p1);
        const Bytes best = S::least(S::least(costs.v[n], jump), slope);
        next.v[n] = S::add_saturated(S::sub_saturated(best, least), S::load(cost + n * kVector));
      }
      costs = next;
      least = Body::least(next);
    }
  };

  static Path vertical_step(const PathRow& row, int x) {
    const std::size_t at = static_cast<std::size_t>(x) * kBytes;
    Path path;
    path.costs = load(row.vertical + at);
    path.least = S::splat(row.vertical_min[x]);
    path.step(row.cost + at, row.penalty_1, row.penalty_north[x]);
    store(row.vertical + at, path.costs);
    row.vertical_min[x] = S::first(path.least);
    return path;
  }

  static void forward_row(const PathRow& row) {
    Path west;
    for (int x = 0; x < row.width; ++x) {
      const std::size_t at = static_cast<std::size_t>(x) * kBytes;
      west.step(row.cost + at, row.penalty_1, row.penalty_west[x]);
      const Path north = vertical_step(row, x);
      store(row.sum + at, add_saturated(west.costs, north.costs));
    }
  }
  static void backward_row(const PathRow& row) {
    Path east;
    for (int x = row.width - 1; x >= 0; --x) {
      const std::size_t at = static_cast<std::size_t>(x) * kBytes;
      east.step(row.cost + at, row.penalty_1, row.penalty_west[x + 1]);
      store(row.sum + at, add_saturated(load(row.sum + at), east.costs));
    }
  }
  static void upward_row(const PathRow& row) {
    for (int x = 0; x < row.width; ++x) vertical_step(row, x);
  }

  // The search of winners, right to left; see WinnerRow.
  struct Search {
    const WinnerRow& out;
    Costs lanes;
    Costs right_cost = splat(255);
    Costs right_choice = splat(0);

    explicit Search(const WinnerRow& row) : out(row) {
      for (std::size_t n = 0; n < N; ++n)
        lanes.v[n] = S::add(S::lane_numbers(), S::splat(static_cast<std::uint8_t>(n * kVector)));
    }

    void pixel(int x, Costs costs) {
      const int inside = out.x_first + x;
      if (inside < kDisparities - 1) mask_outside(inside, costs);
      see_from_the_right(x, costs);
      // Stored with room on either side, so that a winner's neighbours are read without a branch.
      alignas(64) std::uint8_t kept[kBytes + 2 * kVector];
      store(kept + kVector, costs);
      const Bytes least = Body::least(costs);
      const std::uint8_t cost = S::first(least);
      const int best = index_of(costs, least);
      const std::uint8_t* at = kept + kVector + best;
      const bool interior = best > 0 && best < kDisparities - 1;
      const std::uint8_t below = at[-1], above = at[1];
      out.winner[x] = static_cast<std::uint8_t>(best);
      out.cost[x] = is_unique(costs, best, out.unique_limit[cost]) ? cost : std::uint8_t{255};
      out.cost_below[x] = interior ? below : cost;
      out.cost_above[x] = interior ? above : cost;
    }

    void mask_outside(int inside, Costs& costs) const {
      if (inside < 0) {
        costs = splat(255);
        return;
      }
      const Bytes limit = S::splat(static_cast<std::uint8_t>(inside));
      for (std::size_t n = 0; n < N; ++n) {
        const Bytes is_inside = S::equal(S::least(lanes.v[n], limit), lanes.v[n]);
        costs.v[n] = S::select(is_inside, S::splat(255), costs.v[n]);
      }
    }

    void see_from_the_right(int x, const Costs& costs) {
      for (std::size_t n = 0; n < N; ++n) {
        const bool last = n + 1 == N;
        const std::size_t next = last ? n : n + 1;
        const Bytes cost =
            S::shift_down(right_cost.v[n], last ? S::splat(255) : right_cost.v[next]);
        const Bytes choice =
            S::shift_down(right_choice.v[n], last ? S::splat(0) : right_choice.v[next]);
        right_cost.v[n] = S::least(cost, costs.v[n]);
        right_choice.v[n] = S::select(S::equal(right_cost.v[n], costs.v[n]), choice, lanes.v[n]);
      }
      out.right_winner[x] = S::first(right_choice.v[0]);
    }

    // Bit d of the 64 that begin with vector n.
    static std::uint64_t two_vectors(std::uint32_t (*bits)(Bytes, Bytes), const Costs& costs,
                                     std::size_t n, Bytes with) {
      std::uint64_t both = bits(costs.v[n], with);
      if (n + 1 < N)
        both |= static_cast<std::uint64_t>(bits(costs.v[n + 1 < N ? n + 1 : n], with)) << kLanes;
      return both;
    }
    static std::uint32_t equal_bits(Bytes v, Bytes with) { return S::bits(S::equal(v, with)); }
    static std::uint32_t not_below_bits(Bytes v, Bytes limit) {
      return S::bits(S::equal(S::sub_saturated(limit, v), S::splat(0)));
    }

    static int index_of(const Costs& costs, Bytes least) {
      int index = 0;
      for (std::size_t n = (N - 1) / 2 * 2 + 2; n >= 2; n -= 2) {
        const std::uint64_t bits = two_vectors(equal_bits, costs, n - 2, least);
        const int first = static_cast<int>(n - 2) * kLanes + __builtin_ctzll(bits | kTopBit);
        index = bits != 0 ? first : index;
      }
      return index;
    }

    static bool is_unique(const Costs& costs, int best, std::uint8_t limit) {
      const Bytes bound = S::splat(limit);
      std::uint64_t far_below = 0;
      for (std::size_t n = 0; n < N; n += 2) {
        const std::uint64_t all = n + 1 < N ? ~std::uint64_t{0} : std::uint64_t{0xFFFFFFFF};
        const std::uint64_t below = ~two_vectors(not_below_bits, costs, n, bound) & all;
        far_below |= below & ~near_bits(best - static_cast<int>(n) * kLanes);
      }
      return far_below == 0;
    }
    // The bits shift - 1, shift and shift + 1, as far as they are among 64.
    static std::uint64_t near_bits(int shift) {
      if constexpr (N <= 2) return std::uint64_t{3} << shift | std::uint64_t{1} << shift >> 1;
      std::uint64_t near = 0;
      for (int s = shift - 1; s <= shift + 1; ++s)
        near |= static_cast<std::uint64_t>(s >= 0 && s < 64) << (s & 63);
      return near;
    }
    static constexpr std::uint64_t kTopBit = std::uint64_t{1} << 63;

    void finish() {
      std::uint8_t kept[kBytes];
      store(kept, right_choice);
      for (int d = 1; d < kDisparities; ++d) out.right_winner[-d] = kept[d];
    }
  };

  static void backward_winners(const PathRow& row, const WinnerRow& out) {
    Path east;
    Search search(out);
    for (int x = row.width - 1; x >= 0; --x) {
      const std::size_t at = static_cast<std::size_t>(x) * kBytes;
      east.step(row.cost + at, row.penalty_1, row.penalty_west[x + 1]);
      search.pixel(x, add_saturated(load(row.sum + at), east.costs));
    }
    search.finish();
  }
  static void upward_winners(const PathRow& row, const WinnerRow& out) {
    Search search(out);
    for (int x = row.width - 1; x >= 0; --x) {
      const Path south = vertical_step(row, x);
      const std::size_t at = static_cast<std::size_t>(x) * kBytes;
      search.pixel(x, add_saturated(load(row.sum + at), south.costs));
    }
    search.finish();
  }
};

// Calls Body<S, disparities / 32>::FUNCTION; the disparities were checked to be 32 .. 256.
#define WS_STEREO_BY_DISPARITIES(FUNCTION, DISPARITIES, ...) \
  switch ((DISPARITIES) / kLanes) {                          \
    case 1:                                                  \
      return Body<S, 1>::FUNCTION(__VA_ARGS__);              \
    case 2:                                                  \
      return Body<S, 2>::FUNCTION(__VA_ARGS__);              \
    case 3:                                                  \
      return Body<S, 3>::FUNCTION(__VA_ARGS__);              \
    case 4:                                                  \
      return Body<S, 4>::FUNCTION(__VA_ARGS__);              \
    case 5:                                                  \
      return Body<S, 5>::FUNCTION(__VA_ARGS__);              \
    case 6:                                                  \
      return Body<S, 6>::FUNCTION(__VA_ARGS__);              \
    case 7:                                                  \
      return Body<S, 7>::FUNCTION(__VA_ARGS__);              \
    default:                                                 \
      return Body<S, 8>::FUNCTION(__VA_ARGS__);              \
  }

template <class S>
struct KernelSet {
  using Bytes = typename S::Bytes;
  using Words = typename S::Words;

  // The comparisons of one census shape, each at an offset known to the compiler.
  template <CensusShape Shape, int Side>
  struct Census {
    static constexpr NeighbourList kNeighbours = census_neighbours(Shape);
    const CensusRow& row;
    int x;
    Words centre[2];

    template <std::size_t K>
    Bytes darker(Bytes bits) const {
      constexpr Neighbour n = kNeighbours.of[K];
      const std::uint16_t* at = row.rows[n.dy + 2] + x + Side * n.dx;
      return S::add(S::add(bits, bits),
                    S::below(S::load_words(at), centre[0], S::load_words(at + 16), centre[1]));
    }
    template <std::size_t Plane>
    void plane() const {
      const Bytes two = darker<4 * Plane + 1>(darker<4 * Plane>(S::splat(0)));
      const Bytes four = darker<4 * Plane + 3>(darker<4 * Plane + 2>(two));
      S::store(row.planes + static_cast<int>(Plane) * kPlaneStride + x, S::in_order(four));
    }
    template <std::size_t... Planes>
    void planes(std::index_sequence<Planes...>) const {
      (plane<Planes>(), ...);
    }
  };

  template <CensusShape Shape, int Side>
  static void census_row_as(const CensusRow& row) {
    for (int x = 0; x < row.width; x += kLanes) {
      const std::uint16_t* centre = row.rows[2] + x;
      const Census<Shape, Side> census{row, x, {S::load_words(centre), S::load_words(centre + 16)}};
      census.planes(std::make_index_sequence<static_cast<std::size_t>(plane_count(Shape))>());
    }
  }
  static void census_row(const CensusRow& row) {
    if (row.shape == CensusShape::kNarrow)
      row.mirrored ? census_row_as<CensusShape::kNarrow, -1>(row)
                   : census_row_as<CensusShape::kNarrow, 1>(row);
    else
      row.mirrored ? census_row_as<CensusShape::kWide, -1>(row)
                   : census_row_as<CensusShape::kWide, 1>(row);
  }

  static void hamming_row(const HammingRow& row) {
    WS_STEREO_BY_DISPARITIES(hamming, row.disparities, row)
  }
  static void box_row(const BoxRow& row) { WS_STEREO_BY_DISPARITIES(box_row, row.disparities, row) }
  static void forward_row(const PathRow& row) {
    WS_STEREO_BY_DISPARITIES(forward_row, row.disparities, row)
  }
  static void backward_row(const PathRow& row) {
    WS_STEREO_BY_DISPARITIES(backward_row, row.disparities, row)
  }
  static void backward_winners(const PathRow& row, const WinnerRow& out) {
    WS_STEREO_BY_DISPARITIES(backward_winners, row.disparities, row, out)
  }
  static void upward_row(const PathRow& row) {
    WS_STEREO_BY_DISPARITIES(upward_row, row.disparities, row)
  }
  static void upward_winners(const PathRow& row, const WinnerRow& out) {
    WS_STEREO_BY_DISPARITIES(upward_winners, row.disparities, row, out)
  }

  static void sort_two(Words& a, Words& b) {
    const Words low = S::least_signed(a, b);
    b = S::most_signed(a, b);
    a = low;
  }
  // Median of nine by columns (Smith 1996): sort each column, then the median of the largest of
  // the least, the middle of the middle and the least of the largest.
  static void median_row(const MedianRow& row) {
    for (int x = 0; x < row.width; x += 16) {
      Words low[3], middle[3], high[3];
      for (int i = 0; i < 3; ++i) {
        low[i] = S::load_signed(row.rows[0] + x + i - 1);
        middle[i] = S::load_signed(row.rows[1] + x + i - 1);
        high[i] = S::load_signed(row.rows[2] + x + i - 1);
      }
      const Words centre = middle[1];
      for (int i = 0; i < 3; ++i) {
        sort_two(low[i], middle[i]);
        sort_two(middle[i], high[i]);
        sort_two(low[i], middle[i]);
      }
      Words a = S::most_signed(S::most_signed(low[0], low[1]), low[2]);
      sort_two(middle[0], middle[1]);
      Words b = S::most_signed(middle[0], S::least_signed(middle[1], middle[2]));
      Words c = S::least_signed(S::least_signed(high[0], high[1]), high[2]);
      sort_two(a, b);
      sort_two(b, c);
      sort_two(a, b);
      S::store_signed(row.out + x, S::where_not_negative(centre, b));
    }
  }

  static constexpr Kernels named(const char* name) {
    using Loops = RowLoops<S>;
    return {name,           census_row,         hamming_row,        box_row,
            forward_row,    backward_row,       backward_winners,   upward_row,
            upward_winners, Loops::texture_row, Loops::penalty_row, Loops::disparity_row,
            median_row};
  }
};

#undef WS_STEREO_BY_DISPARITIES

}  // namespace wagonsight::stereo_kernels
