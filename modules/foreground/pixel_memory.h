#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "base/bounded_vector.h"
#include "foreground/sensor_view.h"
#include "frame/image.h"

namespace wagonsight {

// What the last frames of each pixel say about trusting it: who sees ever farther without settling
// looks at somebody who walks away; who flickers in small spots looks at an edge, a plant or a
// screen. Allocates in the constructor only.
class PixelMemory {
 public:
  explicit PixelMemory(const SensorView& view);

  // Edges and the borders of holes flicker; they are not trusted until a few seconds have passed.
  // Rows first_row..end_row - 1.
  void distrust_edges(const SensorView& view, DepthImage image, int first_row, int end_row);
  // Moves pixels from `unknown` to `foreground` that see beyond all background and saw another
  // depth in each of the frames before.
  void promote_moving(const SensorView& view, DepthImage image, float frame_s,
                      std::span<std::uint64_t> foreground, std::span<std::uint64_t> unknown);
  // Moves restless pixels from `foreground` to `restless`.
  void set_aside(std::span<std::uint64_t> foreground, std::span<std::uint64_t> restless) const;
  // `small` are foreground pixels in no or only a small blob; those that were none in the frame
  // before count as a flicker. Time heals: `round_share` of the pixels become a bit calmer.
  void observe(std::span<const std::uint64_t> small, std::span<const std::uint64_t> all,
               float round_share);

  // Words whose unknown pixels could not be remembered, so far.
  std::uint64_t motions_refused() const { return motions_refused_; }

 private:
  struct Motion {            // of a pixel that sees beyond all background
    std::uint8_t moves : 2;  // 3: three or more
    std::uint8_t still : 6;  // since the last, in 20 ms, 63: as long or longer
  };

  // Few words of 64 pixels have any that saw beyond all background in the frame before; only those
  // are remembered, in a quarter of all words at most; beyond that such pixels are not promoted.
  struct Motions {
    std::array<std::uint16_t, 64> moved_to;  // raw
    std::array<Motion, 64> motion;
  };
  static constexpr std::uint16_t kNone = UINT16_MAX;
  std::uint16_t motions_of(std::size_t word);
  void release_motions(std::size_t word);

  BoundedVector<Motions> motions_;
  BoundedVector<std::uint16_t> free_motions_;
  BoundedVector<std::uint16_t> motions_at_;  // by word, kNone: there are none
  std::uint64_t motions_refused_ = 0;
  BoundedVector<std::uint64_t> unknown_before_, foreground_before_;
  BoundedVector<std::uint64_t> restless_;  // a bit a pixel: unrest_ is above the limit
  BoundedVector<std::uint8_t> unrest_;
  std::size_t next_word_ = 0;
};

}  // namespace wagonsight
