#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "base/capacities.h"
#include "base/result.h"

namespace wagonsight {

// A leaf's place in the octree: block (4 x 4 x 4 bricks), brick (8 x 8 x 8 leaves) and leaf, each
// level in Morton order. address = brick * 512 + leaf; brick = block * 64 + place in the block.
using LeafAddress = std::uint32_t;
using BrickAddress = std::uint32_t;
inline constexpr LeafAddress kNoLeaf = UINT32_MAX;

// Leaf coordinates: x, y, z count leaves from the grid's minimum corner along the axes of W.
using LeafIndex = std::array<int, 3>;

// The box of air that an octree covers and how it is cut into leaves. Axes are those of the world
// frame W; leaf (i, j, k) is the half-open cube [min + (i, j, k) * leaf_m, + leaf_m). Flat; no
// allocation.
class LeafGrid {
 public:
  LeafGrid() = default;
  // Covers [min, max] (metres, W) and rounds the far side up to whole blocks of 32 leaves. The
  // Error says what is wrong: a leaf outside 0.01 to 0.10 m, an empty box, or more bricks than
  // kOctreeBricksMax and the leaf size that would do.
  static Result<LeafGrid> cover(const Eigen::Vector3d& min, const Eigen::Vector3d& max,
                                double leaf_m);

  double leaf_m() const { return leaf_m_; }
  const Eigen::Vector3d& min() const { return min_; }
  const std::array<int, 3>& leaves() const { return leaves_; }  // along x, y, z
  std::size_t brick_count() const;
  std::size_t block_count() const { return brick_count() / 64; }

  bool contains(const LeafIndex& leaf) const {
    return static_cast<unsigned>(leaf[0]) < static_cast<unsigned>(leaves_[0]) &&
           static_cast<unsigned>(leaf[1]) < static_cast<unsigned>(leaves_[1]) &&
           static_cast<unsigned>(leaf[2]) < static_cast<unsigned>(leaves_[2]);
  }
  // The leaf that holds a point of W; it may lie outside of the grid.
  LeafIndex leaf_of(const Eigen::Vector3d& p_W) const;
  // Valid for leaves that the grid contains.
  LeafAddress address(const LeafIndex& leaf) const {
    const auto x = static_cast<unsigned>(leaf[0]);
    const auto y = static_cast<unsigned>(leaf[1]);
    const auto z = static_cast<unsigned>(leaf[2]);
    const unsigned block = ((z >> 5) * blocks_[1] + (y >> 5)) * blocks_[0] + (x >> 5);
    return (block << 15) | kSpread[x & 31] | (unsigned{kSpread[y & 31]} << 1) |
           (unsigned{kSpread[z & 31]} << 2);
  }
  LeafIndex leaf_at(LeafAddress address) const;
  // The same for a leaf of a brick whose first leaf, that with the least coordinates, is known.
  static LeafIndex leaf_in_brick(const LeafIndex& first, LeafAddress address) {
    const unsigned place = kPlaces[address % kBrickLeaves];
    return {first[0] + static_cast<int>(place & 7U), first[1] + static_cast<int>(place >> 3 & 7U),
            first[2] + static_cast<int>(place >> 6)};
  }
  // The corner of a leaf with the least coordinates (W, metres).
  Eigen::Vector3d corner(const LeafIndex& leaf) const {
    return min_ + leaf_m_ * Eigen::Vector3d(leaf[0], leaf[1], leaf[2]);
  }
  // The centre of a leaf, not rounded (W, metres).
  Eigen::Vector3d centre(const LeafIndex& leaf) const {
    return min_ + leaf_m_ * (Eigen::Vector3d(leaf[0], leaf[1], leaf[2]).array() + 0.5).matrix();
  }

  friend bool operator==(const LeafGrid& a, const LeafGrid& b) {
    return a.min_ == b.min_ && a.leaf_m_ == b.leaf_m_ && a.leaves_ == b.leaves_;
  }

 private:
  // Bits 0..4 of a coordinate to every third bit: the Morton code's x part.
  static constexpr unsigned spread(unsigned value) {
    return (value & 1U) | ((value & 2U) << 2) | ((value & 4U) << 4) | ((value & 8U) << 6) |
           ((value & 16U) << 8);
  }
  static constexpr std::array<std::uint16_t, 32> make_spread() {
    std::array<std::uint16_t, 32> table{};
    for (unsigned i = 0; i < 32; ++i) table[i] = static_cast<std::uint16_t>(spread(i));
    return table;
  }
  // By a leaf's number in its brick: x, y and z in three bits each.
  static constexpr std::array<std::uint16_t, kBrickLeaves> make_places() {
    std::array<std::uint16_t, kBrickLeaves> table{};
    for (unsigned z = 0; z < 8; ++z)
      for (unsigned y = 0; y < 8; ++y)
        for (unsigned x = 0; x < 8; ++x)
          table[spread(x) | spread(y) << 1 | spread(z) << 2] =
              static_cast<std::uint16_t>(x | y << 3 | z << 6);
    return table;
  }
  static const std::array<std::uint16_t, 32> kSpread;
  static const std::array<std::uint16_t, kBrickLeaves> kPlaces;

  Eigen::Vector3d min_ = Eigen::Vector3d::Zero();
  double leaf_m_ = 0;
  std::array<int, 3> leaves_{};
  std::array<unsigned, 3> blocks_{};
};

inline constexpr std::array<std::uint16_t, 32> LeafGrid::kSpread = LeafGrid::make_spread();
inline constexpr std::array<std::uint16_t, kBrickLeaves> LeafGrid::kPlaces =
    LeafGrid::make_places();

}  // namespace wagonsight
