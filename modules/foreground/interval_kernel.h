#pragma once

#include <cstddef>
#include <cstdint>

namespace wagonsight {

// Raw readings against what RayThresholds remembers of each pixel, arrays of one value a pixel.
struct IntervalArrays {
  const std::uint16_t* near;  // inside the wagon from here, or nullptr: from near_all everywhere
  std::uint16_t near_all;     // at least 1, as `near`: no reading is never inside
  // By word of 64 pixels: some of its pixels are inside to here and all of them are at least to
  // there; 0: nowhere.
  const std::uint16_t *far_most, *far_least;
  const std::uint16_t *first_near, *first_far;  // the nearest background interval
  // The next one; where there is none it begins behind every reading and ends where the first does.
  const std::uint16_t *second_near, *second_far;
};

// For 64 pixels a word: bits of `before` are set where the reading is inside the wagon, in neither
// interval, and not beyond second_far; bits of `beyond` likewise, but beyond it. Of a reading
// between the far_least and the far_most of its word both bits are set: whoever calls must look
// where that pixel's ray leaves the wagon. Never allocates.
using IntervalKernel = void (*)(const std::uint16_t* raw, const IntervalArrays& arrays,
                                std::size_t words, std::uint64_t* before, std::uint64_t* beyond);

// The specification, in plain code.
void compare_intervals_scalar(const std::uint16_t* raw, const IntervalArrays& arrays,
                              std::size_t words, std::uint64_t* before, std::uint64_t* beyond);
// 16 pixels at a time; the same bits. Only on a processor with AVX2.
void compare_intervals_avx2(const std::uint16_t* raw, const IntervalArrays& arrays,
                            std::size_t words, std::uint64_t* before, std::uint64_t* beyond);
bool has_avx2();
// The fastest that this processor has.
IntervalKernel best_interval_kernel();

}  // namespace wagonsight
