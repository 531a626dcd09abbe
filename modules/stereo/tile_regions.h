#pragma once

#include <cstdint>
#include <span>

#include "base/bounded_vector.h"
#include "stereo/gray_image.h"

// Rectangles around marked tiles.
namespace wagonsight {

// Few disjoint rectangles that cover all marked tiles, at little cost: a rectangle costs the area
// that it has when widened by `around` on every side, so that one around two groups may be cheaper
// than one around each, and two boxes beside each other cheaper than one around an L. Allocates in
// the constructor only; deterministic.
class TileRegions {
 public:
  // A grid of columns x rows tiles; `around` in tiles.
  TileRegions(int columns, int rows, double around);

  // `marked` has a byte a tile, row by row: 1 where it is to be covered; used up. In tiles, valid
  // until the next call; the whole grid when it would take more than kRegionsMax.
  std::span<const PixelRect> cover(std::span<std::uint8_t> marked);

  // Of what cover() returned last, and of the whole grid: in tiles.
  double cost() const;
  double cost_of_all() const { return cost_of({0, 0, columns_, rows_}); }

  static constexpr std::size_t kRegionsMax = 64;

 private:
  double cost_of(const PixelRect& rect) const;
  double gain_of(const PixelRect& a, const PixelRect& b) const;
  bool is_free(const PixelRect& rect, std::size_t but, std::size_t but_too) const;
  bool take_run(const PixelRect& run, std::span<std::uint8_t> marked);
  bool merge_two();

  int columns_, rows_;
  double around_;
  BoundedVector<PixelRect> regions_;
};

}  // namespace wagonsight
