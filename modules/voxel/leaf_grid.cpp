#include "voxel/leaf_grid.h"

#include <fmt/format.h>

#include <cmath>

namespace wagonsight {
namespace {

constexpr int kBlockLeaves = 32;  // along one axis

unsigned compact(unsigned spread) {
  return (spread & 1U) | ((spread >> 2) & 2U) | ((spread >> 4) & 4U) | ((spread >> 6) & 8U) |
         ((spread >> 8) & 16U);
}

}  // namespace

Result<LeafGrid> LeafGrid::cover(const Eigen::Vector3d& min, const Eigen::Vector3d& max,
                                 double leaf_m) {
  if (!(leaf_m >= 0.01 && leaf_m <= 0.10)) {
    return fail(fmt::format("the octree's leaf size is {} m: choose 0.01 to 0.10 m", leaf_m));
  }
  if (!min.allFinite() || !max.allFinite() || !(min.array() < max.array()).all()) {
    return fail("the octree's box is empty: give the wagon's inside a positive size on each axis");
  }
  LeafGrid grid;
  grid.min_ = min;
  grid.leaf_m_ = leaf_m;
  double bricks = 1;
  for (int axis = 0; axis < 3; ++axis) {
    const double blocks = std::ceil((max[axis] - min[axis]) / (leaf_m * kBlockLeaves));
    bricks *= blocks * 4;
    if (bricks > static_cast<double>(kOctreeBricksMax)) break;
    grid.blocks_[static_cast<std::size_t>(axis)] = static_cast<unsigned>(blocks);
    grid.leaves_[static_cast<std::size_t>(axis)] = static_cast<int>(blocks) * kBlockLeaves;
  }
  if (bricks > static_cast<double>(kOctreeBricksMax)) {
    const double volume = (max - min).prod();
    const double enough = std::cbrt(volume / static_cast<double>(kOctreeBricksMax)) / 8;
    return fail(
        fmt::format("a box of {:.1f} x {:.1f} x {:.1f} m has too many leaves of {} m: "
                    "choose a leaf above {:.3f} m or a smaller inside",
                    max.x() - min.x(), max.y() - min.y(), max.z() - min.z(), leaf_m, enough));
  }
  return grid;
}

std::size_t LeafGrid::brick_count() const {
  return std::size_t{blocks_[0]} * blocks_[1] * blocks_[2] * 64;
}

LeafIndex LeafGrid::leaf_of(const Eigen::Vector3d& p_W) const {
  const Eigen::Vector3d scaled = (p_W - min_) / leaf_m_;
  return {static_cast<int>(std::floor(scaled.x())), static_cast<int>(std::floor(scaled.y())),
          static_cast<int>(std::floor(scaled.z()))};
}

LeafIndex LeafGrid::leaf_at(LeafAddress address) const {
  const unsigned block = address >> 15;
  const unsigned x = (block % blocks_[0]) * kBlockLeaves + compact(address & 0x7FFF);
  const unsigned y =
      (block / blocks_[0] % blocks_[1]) * kBlockLeaves + compact((address >> 1) & 0x7FFF);
  const unsigned z =
      block / (blocks_[0] * blocks_[1]) * kBlockLeaves + compact((address >> 2) & 0x7FFF);
  return {static_cast<int>(x), static_cast<int>(y), static_cast<int>(z)};
}

}  // namespace wagonsight
