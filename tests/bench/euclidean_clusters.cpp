#include "bench/euclidean_clusters.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace wagonsight::bench {
namespace {

constexpr std::uint32_t kNoPoint = UINT32_MAX;

}  // namespace

EuclideanClusters::EuclideanClusters(const Bounds& inside, double tolerance_m,
                                     std::size_t points_max)
    : min_((inside.min.array() - 0.3).matrix().cast<float>()),
      per_cell_(static_cast<float>(std::sqrt(3.0) / tolerance_m)),
      tolerance_squared_(static_cast<float>(tolerance_m * tolerance_m)),
      cells_(points_max),
      next_point_(points_max) {
  std::size_t count = 1;
  for (int axis = 0; axis < 3; ++axis) {
    const double length = inside.max[axis] - inside.min[axis] + 0.6;
    size_[axis] = static_cast<int>(std::ceil(length * static_cast<double>(per_cell_))) + 4;
    count *= static_cast<std::size_t>(size_[axis]);
  }
  cell_at_ = std::make_unique<std::uint32_t[]>(count);
  row_bytes_ = static_cast<std::size_t>(size_[0]) / 8 + 2;
  occupied_ = std::make_unique<std::uint8_t[]>(row_bytes_ * static_cast<std::size_t>(size_[1]) *
                                               static_cast<std::size_t>(size_[2]));
}

std::uint32_t EuclideanClusters::root(std::uint32_t cell) {
  while (cells_[cell].parent != cell) {
    cells_[cell].parent = cells_[cells_[cell].parent].parent;
    cell = cells_[cell].parent;
  }
  return cell;
}

void EuclideanClusters::fill(std::span<const ForegroundPoint> points) {
  cells_.clear();
  next_point_.resize(points.size());
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    const int place[3] = {static_cast<int>((points[i].x - min_.x()) * per_cell_) + 2,
                          static_cast<int>((points[i].y - min_.y()) * per_cell_) + 2,
                          static_cast<int>((points[i].z - min_.z()) * per_cell_) + 2};
    const int x = std::clamp(place[0], 2, size_[0] - 3), y = std::clamp(place[1], 2, size_[1] - 3),
              z = std::clamp(place[2], 2, size_[2] - 3);
    const auto row = static_cast<std::uint32_t>(z * size_[1] + y);
    const auto place_in_grid =
        row * static_cast<std::uint32_t>(size_[0]) + static_cast<std::uint32_t>(x);
    std::uint32_t& at = cell_at_[place_in_grid];
    if (at == 0) {
      const auto index = static_cast<std::uint32_t>(cells_.size());
      const auto bits = row * static_cast<std::uint32_t>(row_bytes_);
      const auto left = static_cast<std::uint32_t>(x - 2);
      (void)cells_.try_push_back({kNoPoint, index, 0, place_in_grid, bits + left / 8, left % 8});
      at = index + 1;
      occupied_[bits + static_cast<std::uint32_t>(x) / 8] |=
          static_cast<std::uint8_t>(1U << (x % 8));
    }
    Cell& cell = cells_[at - 1];
    next_point_[i] = cell.first;
    cell.first = i;
    ++cell.points;
  }
}

void EuclideanClusters::join(std::span<const ForegroundPoint> points, std::uint32_t a,
                             std::uint32_t b) {
  if (cells_[a].parent == cells_[b].parent) return;
  const std::uint32_t root_a = root(a), root_b = root(b);
  cells_[a].parent = root_a;
  cells_[b].parent = root_b;
  if (root_a == root_b) return;
  for (std::uint32_t i = cells_[a].first; i != kNoPoint; i = next_point_[i]) {
    for (std::uint32_t j = cells_[b].first; j != kNoPoint; j = next_point_[j]) {
      const float dx = points[i].x - points[j].x, dy = points[i].y - points[j].y,
                  dz = points[i].z - points[j].z;
      if (dx * dx + dy * dy + dz * dz > tolerance_squared_) continue;
      cells_[std::max(root_a, root_b)].parent = std::min(root_a, root_b);
      return;
    }
  }
}

void EuclideanClusters::join_row(std::span<const ForegroundPoint> points, int dy, int dz,
                                 unsigned offsets) {
  const int rows = dz * size_[1] + dy;
  const auto bytes_on = static_cast<std::ptrdiff_t>(rows) * static_cast<std::ptrdiff_t>(row_bytes_);
  const auto cells_on = static_cast<std::ptrdiff_t>(rows) * size_[0] - 2;
  for (std::uint32_t index = 0; index < cells_.size(); ++index) {
    const Cell& cell = cells_[index];
    const std::uint8_t* const bits = &occupied_[cell.bits_at] + bytes_on;
    unsigned there = (static_cast<unsigned>(bits[0] | bits[1] << 8) >> cell.shift) & offsets;
    for (; there != 0; there &= there - 1) {
      join(points, index, *(&cell_at_[cell.at] + cells_on + std::countr_zero(there)) - 1);
    }
  }
}

std::size_t EuclideanClusters::count(std::span<const ForegroundPoint> points,
                                     std::uint32_t points_min) {
  fill(points);
  // The half of the neighbourhood that comes before; the other half looks from its own side.
  constexpr unsigned kNear = 0b01110, kAll = 0b11111, kBefore = 0b00011;
  join_row(points, 0, 0, kBefore);
  for (int dz = -1; dz <= 0; ++dz) {
    for (int dy = -1; dy <= (dz == 0 ? -1 : 1); ++dy) join_row(points, dy, dz, kNear);
  }
  for (int dz = -2; dz <= 0; ++dz) {
    for (int dy = -2; dy <= (dz == 0 ? -1 : 2); ++dy) {
      const bool near = dz >= -1 && dy >= -1 && dy <= 1;
      join_row(points, dy, dz, near ? kAll & ~kNear : kAll);
    }
  }
  std::size_t clusters = 0;
  for (std::uint32_t index = 0; index < cells_.size(); ++index) {
    const std::uint32_t top = root(index);
    if (top != index) cells_[top].points += cells_[index].points;
  }
  for (std::uint32_t index = 0; index < cells_.size(); ++index) {
    const Cell& cell = cells_[index];
    if (cell.parent == index && cell.points >= points_min) ++clusters;
    cell_at_[cell.at] = 0;
    occupied_[cell.bits_at + (cell.shift + 2) / 8] = 0;
  }
  return clusters;
}

}  // namespace wagonsight::bench
