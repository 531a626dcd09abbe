#pragma once

#include <cstddef>
#include <cstdint>

// One pixel of rectify(): the specification, and the tail of the faster builds.
namespace wagonsight::stereo_kernels {

inline constexpr int kResampleRound = 512;  // half of 32 * 32
inline constexpr int kResampleShift = 10;

// A template over a tag, so that each instruction set's file has a copy of its own.
template <class Tag, class Pixel>
void resample_pixels(const std::uint32_t* table, std::size_t begin, std::size_t end, int width,
                     const Pixel* source, Pixel* out) {
  for (std::size_t i = begin; i < end; ++i) {
    const std::uint32_t entry = table[i];
    if (entry >> 31 != 0) {
      out[i] = 0;
      continue;
    }
    const int fine_u = static_cast<int>(entry & 31), fine_v = static_cast<int>(entry >> 5 & 31);
    const Pixel* at = source + (entry >> 10);
    const int upper = at[0] * (32 - fine_u) + at[1] * fine_u;
    const int lower = at[width] * (32 - fine_u) + at[width + 1] * fine_u;
    out[i] = static_cast<Pixel>((upper * (32 - fine_v) + lower * fine_v + kResampleRound) >>
                                kResampleShift);
  }
}

}  // namespace wagonsight::stereo_kernels
