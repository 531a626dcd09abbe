#include "stereo/tile_regions.h"

#include <algorithm>

#include "base/check.h"

namespace wagonsight {
namespace {

constexpr std::uint8_t kCovered = 2;

bool overlap(const PixelRect& a, const PixelRect& b) {
  return a.x0 < b.x1 && b.x0 < a.x1 && a.y0 < b.y1 && b.y0 < a.y1;
}

PixelRect around_both(const PixelRect& a, const PixelRect& b) {
  return {std::min(a.x0, b.x0), std::min(a.y0, b.y0), std::max(a.x1, b.x1), std::max(a.y1, b.y1)};
}

}  // namespace

TileRegions::TileRegions(int columns, int rows, double around)
    : columns_(columns), rows_(rows), around_(around), regions_(kRegionsMax) {}

double TileRegions::cost_of(const PixelRect& rect) const {
  return (rect.x1 - rect.x0 + 2 * around_) * (rect.y1 - rect.y0 + 2 * around_);
}

double TileRegions::cost() const {
  double sum = 0;
  for (const PixelRect& region : regions_) sum += cost_of(region);
  return sum;
}

double TileRegions::gain_of(const PixelRect& a, const PixelRect& b) const {
  return cost_of(a) + cost_of(b) - cost_of(around_both(a, b));
}

// No region but those two overlaps it.
bool TileRegions::is_free(const PixelRect& rect, std::size_t but, std::size_t but_too) const {
  for (std::size_t i = 0; i < regions_.size(); ++i)
    if (i != but && i != but_too && overlap(regions_[i], rect)) return false;
  return true;
}

std::span<const PixelRect> TileRegions::cover(std::span<std::uint8_t> marked) {
  WS_CHECK(marked.size() == static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_),
           "%zu tiles of %d x %d", marked.size(), columns_, rows_);
  regions_.clear();
  for (int row = 0; row < rows_; ++row)
    for (int column = 0; column < columns_; ++column) {
      const std::uint8_t* tiles = marked.data() + row * columns_;
      if (tiles[column] != 1) continue;
      int end = column + 1;
      while (end < columns_ && tiles[end] == 1) ++end;
      if (take_run({column, row, end, row + 1}, marked)) continue;
      regions_.clear();
      (void)regions_.try_push_back({0, 0, columns_, rows_});  // there is room: it was cleared
      return regions_.span();
    }
  while (merge_two()) {
  }
  // Two may be kept apart by a third; all together may still be cheaper.
  PixelRect all = regions_.empty() ? PixelRect{} : regions_[0];
  for (const PixelRect& region : regions_) all = around_both(all, region);
  if (regions_.size() > 1 && cost_of(all) <= cost()) {
    regions_.clear();
    (void)regions_.try_push_back(all);  // there is room: it was cleared
  }
  return regions_.span();
}

// The run joins the region right above it with which it is cheapest, or begins one; false: there is
// no room.
bool TileRegions::take_run(const PixelRect& run, std::span<std::uint8_t> marked) {
  std::size_t best = regions_.size();
  double gain = 0;
  for (std::size_t i = 0; i < regions_.size(); ++i) {
    if (regions_[i].y1 < run.y0) continue;
    const double own = gain_of(regions_[i], run);
    if (own < gain || !is_free(around_both(regions_[i], run), i, i)) continue;
    best = i;
    gain = own;
  }
  PixelRect taken = run;
  if (best < regions_.size()) {
    taken = regions_[best] = around_both(regions_[best], run);
  } else if (!regions_.try_push_back(run)) {
    return false;
  }
  std::fill_n(marked.data() + run.y0 * columns_ + taken.x0, taken.x1 - taken.x0, kCovered);
  return true;
}

bool TileRegions::merge_two() {
  for (std::size_t a = 0; a < regions_.size(); ++a)
    for (std::size_t b = a + 1; b < regions_.size(); ++b) {
      if (gain_of(regions_[a], regions_[b]) < 0) continue;
      const PixelRect both = around_both(regions_[a], regions_[b]);
      if (!is_free(both, a, b)) continue;
      regions_[a] = both;
      regions_[b] = regions_[regions_.size() - 1];
      regions_.resize(regions_.size() - 1);
      return true;
    }
  return false;
}

}  // namespace wagonsight
