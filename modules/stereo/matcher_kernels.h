#pragma once

#include <cstddef>
#include <cstdint>

// The inner loops of the matcher, one row of pixels at a time, in three builds that give the same
// bytes: scalar (the specification), AVX2 and NEON. No kernel allocates.
//
// A cost row holds `disparities` bytes a pixel: cost[x * disparities + d]. Sums saturate at 255.
namespace wagonsight::stereo_kernels {

// Disparities are handled 32 at a time; a winner's index is one byte.
inline constexpr int kLanes = 32;
inline constexpr int kDisparitiesMax = 256;

// A disparity is told in 64ths of a pixel; kNoDisparity where the images do not support a match.
inline constexpr int kDisparityScale = 64;
inline constexpr std::int16_t kNoDisparity = -1;

// Census (Zabih and Woodfill 1994): one bit a neighbour, set where it is darker than the centre.
// Four bits lie in each plane's byte, so that a Hamming distance is one table look-up a plane.
//   kNarrow  5x5 without its centre, 24 bits, 6 planes
//   kWide    7x5 without its centre and the two ends of the middle row, 32 bits, 8 planes
enum class CensusShape : std::uint8_t { kNarrow, kWide };
inline constexpr int kPlanesMax = 8;
inline constexpr int kCensusReach = 3;  // columns to either side of a pixel
constexpr int plane_count(CensusShape shape) {
  return shape == CensusShape::kNarrow ? 6 : 8;
}

// Grays are below 2^15. Rows are readable from -kCensusReach to the width rounded up to 32, plus
// kCensusReach; planes are written up to the rounded width.
inline constexpr int kPlaneStride = 2304;  // bytes from plane to plane; no multiple of a page
inline constexpr int kWidthMax = kPlaneStride - kDisparitiesMax - 2 * kLanes;
struct CensusRow {
  const std::uint16_t* rows[5];  // y-2 .. y+2
  int width;
  CensusShape shape;
  bool mirrored;  // the row runs right to left (the right image's does): neighbours swap sides
  std::uint8_t* planes;
};

// cost(x, d) = Hamming distance of left(x) and right[d - x], for x in [0, width).
struct HammingRow {
  const std::uint8_t* left;
  const std::uint8_t* right;  // at x = 0, d = 0; it runs right to left
  int planes;
  int width;
  int disparities;
  std::uint8_t* cost;
};

// cost(x) = sum over i = -1, 0, 1 of (above(x+i) + here(x+i) + below(x+i) + 1) / 2; x is clamped.
// Halved once more, rounded up, where `halved`.
struct BoxRow {
  const std::uint8_t* above;
  const std::uint8_t* here;
  const std::uint8_t* below;
  int width;
  int disparities;
  bool halved;
  std::uint8_t* cost;
};

// One step of a path (Hirschmueller 2008, equation 13), m the least of the path's previous costs:
//   L(d) = cost(d) + min(L'(d), L'(d-1) + P1, L'(d+1) + P1, m + P2) - m
// P2 is given for each pixel (towards its predecessor). forward_row runs left to right and writes
// the sum of the paths from the west and from the north; backward_row adds the path from the east.
struct PathRow {
  const std::uint8_t* cost;
  const std::uint8_t* penalty_west;   // P2 between x-1 and x; entry `width` is read too
  const std::uint8_t* penalty_north;  // P2 between the previous row (in the path's sense) and this
  std::uint8_t penalty_1;
  int width;
  int disparities;
  std::uint8_t* vertical;      // the vertical path: the previous row's costs in, this row's out
  std::uint8_t* vertical_min;  // their minima, a byte a pixel
  std::uint8_t* sum;
};

// The winner of each pixel (its least cost, the smaller disparity where two are equal), found from
// right to left; the row's sums are used up. `cost` becomes 255 where there is no winner: no cost
// is below 255, or one other than the winner's two neighbours is below unique_limit[least].
// cost_below and cost_above are those of the winner's neighbours; where it has only one, both are
// the winner's own. right_winner[x] is the disparity that the right image's pixel x (in this row's
// coordinates) would choose of the same sums; it is written from -(disparities - 1) to width - 1.
struct WinnerRow {
  int x_first;  // of the row's first pixel, minus the least disparity: lanes d > x_first + x lie
                // outside of the right image
  const std::uint8_t* unique_limit;  // 256 entries
  std::uint8_t* winner;
  std::uint8_t* cost;
  std::uint8_t* cost_below;
  std::uint8_t* cost_above;
  std::uint8_t* right_winner;
};

// flat(x) = 1 where the grays of three rows differ by less than `least` in all from column to
// column of x - 3 .. x + 3; a difference counts as 2047 at most. Rows are readable from -3 to
// width + 2, `rises` is written there.
struct TextureRow {
  const std::uint16_t* rows[3];
  int width;
  int least;
  std::uint16_t* rises;
  std::uint8_t* flat;
};

// guide(x) = gray(x) * gain / 2^16, at most 255; the penalty P2 between two pixels is
// max(full - slope * |difference of their guides| / 2, least). west[0] and west[width] are `full`.
struct PenaltyRow {
  const std::uint16_t* gray;
  std::uint32_t gain;
  const std::uint8_t* upper_guide;  // the row above's
  std::uint8_t* guide;              // may be upper_guide: then `north` has no edges
  int width;
  int full, least, slope;
  std::uint8_t* west;
  std::uint8_t* north;
};

// From winners to disparities in 64ths of a pixel; kNoDisparity where there is no winner, the pixel
// is flat, or what the right image sees there differs by more than the tolerance. Sub-pixel by the
// equiangular fit, bent outwards: census sums rise too slowly beside their minimum, which draws
// disparities towards whole pixels (Haller and Nedevschi 2012 fit a sine for the same reason).
struct DisparityRow {
  const std::uint8_t* winner;
  const std::uint8_t* cost;
  const std::uint8_t* cost_below;
  const std::uint8_t* cost_above;
  const std::uint8_t* seen_from_right;  // right_winner[x - winner(x)]
  const std::uint8_t* flat;
  int width;
  int tolerance;
  int disparity_min;
  std::int16_t* disparity;
  // The disparity's standard deviation in 64ths of a pixel, as the match itself tells it: 16 where
  // the winner's costs rise steeply to one side and are low themselves, as those of a match that
  // all paths agree on; more the flatter they rise and the higher they are. Measured on pairs with
  // truth (README.md).
  std::uint8_t* sigma;
};

// out(x) = median of the 3x3 neighbourhood, where here(x) holds a disparity; else kNoDisparity.
// Rows are readable from -1 to the width rounded up to 16; out is written up to there.
struct MedianRow {
  const std::int16_t* rows[3];
  int width;
  std::int16_t* out;
};

struct Kernels {
  const char* name;
  void (*census_row)(const CensusRow&);
  void (*hamming_row)(const HammingRow&);
  void (*box_row)(const BoxRow&);
  void (*forward_row)(const PathRow&);                         // sum = west + north
  void (*backward_row)(const PathRow&);                        // sum += east
  void (*backward_winners)(const PathRow&, const WinnerRow&);  // winners of sum + east
  void (*upward_row)(const PathRow&);                          // the vertical path alone
  void (*upward_winners)(const PathRow&, const WinnerRow&);    // winners of sum + vertical
  void (*texture_row)(const TextureRow&);
  void (*penalty_row)(const PenaltyRow&);
  void (*disparity_row)(const DisparityRow&);
  void (*median_row)(const MedianRow&);
};

const Kernels& scalar_kernels();
// The fastest that this processor can run.
const Kernels& best_kernels();

}  // namespace wagonsight::stereo_kernels
