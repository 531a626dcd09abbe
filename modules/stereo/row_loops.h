#pragma once

#include <cstdint>

#include "stereo/matcher_kernels.h"

// Loops that a compiler turns into vectors by itself. They are a template over the instruction set
// so that each set's file gets copies of its own (see kernel_body.h); the arithmetic is exact, so
// all copies give the same bytes.
namespace wagonsight::stereo_kernels {

template <class InstructionSet>
struct RowLoops {
  static int size(int value) { return value < 0 ? -value : value; }
  static int larger(int a, int b) { return a > b ? a : b; }

  static void texture_row(const TextureRow& row) {
    constexpr int kMost = 2047;  // eighteen of them fit a word
    std::uint16_t* __restrict rises = row.rises;
    const int width = row.width;
    const std::uint16_t *a = row.rows[0], *b = row.rows[1], *c = row.rows[2];
    const auto rise = [](std::uint16_t here, std::uint16_t before) {
      const auto difference =
          static_cast<std::uint16_t>(here > before ? here - before : before - here);
      return static_cast<std::uint16_t>(difference > kMost ? kMost : difference);
    };
    for (int x = 1 - kCensusReach; x < width + kCensusReach; ++x)
      rises[x] = static_cast<std::uint16_t>(rise(a[x], a[x - 1]) + rise(b[x], b[x - 1]) +
                                            rise(c[x], c[x - 1]));
    const auto least = static_cast<std::uint16_t>(row.least);
    std::uint8_t* __restrict flat = row.flat;
    for (int x = 0; x < width; ++x) {
      const auto sum = static_cast<std::uint16_t>(rises[x - 2] + rises[x - 1] + rises[x] +
                                                  rises[x + 1] + rises[x + 2] + rises[x + 3]);
      flat[x] = sum < least ? 1 : 0;
    }
  }

  // The fields are copied first: a byte written could be one of the struct's for all that a
  // compiler knows, and then nothing becomes a vector.
  static void penalty_row(const PenaltyRow& row) {
    const int width = row.width;
    const std::uint32_t gain = row.gain;
    const std::uint16_t* gray = row.gray;
    std::uint8_t* __restrict guide = row.guide;
    for (int x = 0; x < width; ++x) {
      const std::uint32_t level = gray[x] * gain >> 16;
      guide[x] = static_cast<std::uint8_t>(level > 255 ? 255 : level);
    }
    penalties_between(row, guide + 1, guide, width - 1, row.west + 1);
    row.west[0] = row.west[width] = static_cast<std::uint8_t>(row.full);
    penalties_between(row, guide, row.upper_guide, width, row.north);
  }
  static void penalties_between(const PenaltyRow& row, const std::uint8_t* a, const std::uint8_t* b,
                                int count, std::uint8_t* __restrict out) {
    const auto full = static_cast<std::int16_t>(row.full);
    const auto slope = static_cast<std::int16_t>(row.slope);
    const auto least = static_cast<std::int16_t>(row.least);
    for (int x = 0; x < count; ++x) {
      const auto difference = static_cast<std::int16_t>(a[x] > b[x] ? a[x] - b[x] : b[x] - a[x]);
      const auto less =
          static_cast<std::int16_t>(full - static_cast<std::int16_t>(slope * difference) / 2);
      out[x] = static_cast<std::uint8_t>(less > least ? less : least);
    }
  }

  // -32 .. 32 from how far the costs of a winner's neighbours rise: the equiangular fit r / 2, with
  // r = -1 .. 1, bent by 0.7 r - 0.2 r^3, rounded half away from zero. Single operations of float,
  // each rounded as the standard says, give the same bytes everywhere.
  static int subpixel_offset(int rise_below, int rise_above) {
    const int most = larger(larger(rise_below, rise_above), 1);
    const int difference = rise_below - rise_above;
    const float r = static_cast<float>(size(difference)) / static_cast<float>(most);
    const float fine = static_cast<float>(kDisparityScale) * (r * (0.7F - 0.2F * (r * r)));
    const int magnitude = static_cast<int>(fine + 0.5F);
    return difference < 0 ? -magnitude : magnitude;
  }

  static int sigma_of(int rise, int cost) {
    constexpr int kLeast = 16, kSteep = 112, kHigh = 110;
    return kLeast + larger(kSteep - rise, 0) / 4 + larger(cost - kHigh, 0) / 4;
  }

  static void disparity_row(const DisparityRow& row) {
    const std::uint8_t *winners = row.winner, *costs = row.cost, *below = row.cost_below,
                       *above = row.cost_above, *seen = row.seen_from_right, *flat = row.flat;
    const int width = row.width, tolerance = row.tolerance, disparity_min = row.disparity_min;
    std::int16_t* __restrict out = row.disparity;
    std::uint8_t* __restrict sigmas = row.sigma;
    for (int x = 0; x < width; ++x) {
      const int winner = winners[x], cost = costs[x];
      const bool good = (size(seen[x] - winner) <= tolerance) & (cost != 255) & (flat[x] == 0);
      const int disparity = (disparity_min + winner) * kDisparityScale +
                            subpixel_offset(below[x] - cost, above[x] - cost);
      out[x] = static_cast<std::int16_t>(good ? disparity : kNoDisparity);
    }
    // A loop of its own: with two results there are more ways to overlap than g++ looks into, and
    // then nothing becomes a vector.
    for (int x = 0; x < width; ++x)
      sigmas[x] =
          static_cast<std::uint8_t>(sigma_of(larger(below[x], above[x]) - costs[x], costs[x]));
  }
};

}  // namespace wagonsight::stereo_kernels
