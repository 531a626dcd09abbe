#include "people/ground_segments.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace wagonsight {
namespace {

constexpr double kCell = 0.05;        // metres: a head is four cells wide
constexpr double kCellsSide = 512;    // coarser cells in rooms of more than 25 m
constexpr float kFloorNoise = 0.15F;  // metres above the floor that may be the floor itself
constexpr float kTopMax = 2.55F;
constexpr std::size_t kLevels = 256;  // of 1 cm
// A head rises 0.25 to 0.3 m above the shoulders; half of it must show above the pass.
constexpr float kRiseMin = 0.13F;
// A third of a head seen from one side (0.035 square metres).
constexpr float kHillAreaMin = 0.012F;
constexpr std::uint32_t kNoHill = UINT32_MAX;

std::size_t level_of(float top) {
  return std::min(kLevels - 1, static_cast<std::size_t>(std::max(0.0F, top * 100.0F)));
}

}  // namespace

GroundSegments::GroundSegments(const Bounds& inside) : inside_(inside) {
  const double length = std::max(inside.max.x() - inside.min.x(), kCell);
  const double depth = std::max(inside.max.y() - inside.min.y(), kCell);
  cells_per_metre_ = 1.0 / std::max(kCell, std::max(length, depth) / kCellsSide);
  width_ = static_cast<int>(std::ceil(length * cells_per_metre_)) + 2;
  height_ = static_cast<int>(std::ceil(depth * cells_per_metre_)) + 2;
  const auto count = static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  cells_ = BoundedVector<Cell>(count);
  cells_.resize(count);
  bridged_ = BoundedVector<float>(count);
  bridged_.resize(count);
  occupied_ = BoundedVector<std::uint32_t>(count);
  ordered_ = BoundedVector<std::uint32_t>(count);
  hills_ = BoundedVector<Hill>(count);
  point_cells_ = BoundedVector<std::uint32_t>(kFusedPointsMax);
  labels_ = BoundedVector<std::uint16_t>(kFusedPointsMax);
}

void GroundSegments::segment(const FusedCloud& cloud) {
  raise(cloud);
  bridge_gaps();
  order_by_height();
  flood();
  labels_.resize(cloud.points.size());
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    const std::uint32_t cell = point_cells_[i];
    labels_[i] = cell == kOutside ? kNoSegment : hills_[root_of(cells_[cell].label)].number;
  }
}

std::uint32_t GroundSegments::cell_of(float x, float y) const {
  const int column = 1 + static_cast<int>(std::floor((x - inside_.min.x()) * cells_per_metre_));
  const int row = 1 + static_cast<int>(std::floor((y - inside_.min.y()) * cells_per_metre_));
  if (column < 1 || row < 1 || column >= width_ - 1 || row >= height_ - 1) return kOutside;
  return static_cast<std::uint32_t>(row * width_ + column);
}

// The highest point over each cell.
void GroundSegments::raise(const FusedCloud& cloud) {
  for (Cell& cell : cells_) cell = Cell{};
  occupied_.clear();
  point_cells_.resize(cloud.points.size());
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    const FusedPoint& p = cloud.points[i];
    point_cells_[i] = kOutside;
    if (p.z < kFloorNoise || p.z > kTopMax) continue;
    const std::uint32_t index = cell_of(p.x, p.y);
    if (index == kOutside) continue;
    point_cells_[i] = index;
    cells_[index].top = std::max(cells_[index].top, p.z);
    cells_[index].area_m2 += p.area_m2;
  }
}

// Depth steps of a far sensor leave stripes; a cell lends its height to its empty neighbours, so
// that stripes up to 15 cm apart are one surface.
void GroundSegments::bridge_gaps() {
  for (float& top : bridged_) top = 0;
  const std::array<int, 8> around{-width_ - 1, -width_,    -width_ + 1, -1,
                                  1,           width_ - 1, width_,      width_ + 1};
  for (int row = 1; row < height_ - 1; ++row)
    for (int column = 1; column < width_ - 1; ++column) {
      const int index = row * width_ + column;
      const float top = cells_[static_cast<std::size_t>(index)].top;
      if (top <= 0) continue;
      float& here = bridged_[static_cast<std::size_t>(index)];
      here = std::max(here, top);
      for (const int step : around) {
        float& there = bridged_[static_cast<std::size_t>(index + step)];
        if (cells_[static_cast<std::size_t>(index + step)].top <= 0) there = std::max(there, top);
      }
    }
  for (std::size_t i = 0; i < cells_.size(); ++i)
    if (bridged_[i] > 0)
      occupied_.resize(occupied_.size() + 1),
          occupied_[occupied_.size() - 1] = static_cast<std::uint32_t>(i);
}

// Counting sort by centimetre; within one level by cell, so the order is always the same.
void GroundSegments::order_by_height() {
  std::array<std::uint32_t, kLevels + 1> first{};
  for (const std::uint32_t cell : occupied_) ++first[kLevels - 1 - level_of(bridged_[cell]) + 1];
  for (std::size_t level = 1; level <= kLevels; ++level) first[level] += first[level - 1];
  ordered_.resize(occupied_.size());
  for (const std::uint32_t cell : occupied_)
    ordered_[first[kLevels - 1 - level_of(bridged_[cell])]++] = cell;
}

std::uint32_t GroundSegments::root_of(std::uint32_t hill) const {
  while (hills_[hill].parent != hill) hill = hills_[hill].parent;
  return hill;
}

// A shoulder belongs to the head above it.
std::uint32_t GroundSegments::nearer_peak(std::uint32_t cell, std::uint32_t a,
                                          std::uint32_t b) const {
  const auto distance2 = [&](std::uint32_t hill) {
    const int from = static_cast<int>(cell);
    const int to = static_cast<int>(hills_[hill].peak_cell);
    const int columns = from % width_ - to % width_;
    const int rows = from / width_ - to / width_;
    return columns * columns + rows * rows;
  };
  return distance2(b) < distance2(a) ? b : a;
}

// Water sinks from the highest cell down; what emerges joins the hill it touches, the one with the
// nearer peak when there are two. Hills that touch there become one unless the lower one has proved
// itself.
void GroundSegments::flood() {
  hills_.clear();
  const std::array<int, 8> around{-width_ - 1, -width_,    -width_ + 1, -1,
                                  1,           width_ - 1, width_,      width_ + 1};
  for (const std::uint32_t index : ordered_) cells_[index].label = kNoHill;
  for (const std::uint32_t index : ordered_) {
    std::uint32_t mine = kNoHill;
    for (const int step : around) {
      const auto next = static_cast<std::uint32_t>(static_cast<int>(index) + step);
      if (next >= cells_.size() || bridged_[next] <= 0 || cells_[next].label == kNoHill) continue;
      const std::uint32_t other = root_of(cells_[next].label);
      if (mine == kNoHill) {
        mine = other;
      } else if (other != mine) {
        const bool mine_higher = hills_[mine].peak >= hills_[other].peak;
        const std::uint32_t high = mine_higher ? mine : other;
        const std::uint32_t low = mine_higher ? other : mine;
        const bool proved =
            hills_[low].peak - bridged_[index] >= kRiseMin && hills_[low].area_m2 >= kHillAreaMin;
        if (!proved) {
          hills_[low].parent = high;
          hills_[high].area_m2 += hills_[low].area_m2;
        }
        mine = proved ? nearer_peak(index, mine, other) : high;
      }
    }
    if (mine == kNoHill) {
      mine = static_cast<std::uint32_t>(hills_.size());
      hills_.resize(hills_.size() + 1);
      hills_[mine] = {bridged_[index], index, 0, mine, kNoSegment};
    }
    cells_[index].label = mine;
    hills_[mine].area_m2 += cells_[index].area_m2;
  }
  count_ = 0;
  for (std::uint32_t i = 0; i < hills_.size(); ++i)
    if (hills_[i].parent == i && count_ < kNoSegment)
      hills_[i].number = static_cast<std::uint16_t>(count_++);
}

}  // namespace wagonsight
