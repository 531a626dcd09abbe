#pragma once

#include <bit>
#include <cstdint>
#include <memory>
#include <span>

#include "base/bounded_vector.h"
#include "voxel/leaf_grid.h"

// A set of leaves as a full octree of bits in fixed memory, and the comparison of two such sets.
namespace wagonsight {

// One bit a leaf. A brick is 8 x 8 x 8 leaves in 64 bytes, Morton order, so a node's eight children
// are one byte and a 4 x 4 x 4 node is one word; a block word above has a bit for each of its
// 4 x 4 x 4 bricks and tells a walk where to skip. Bricks that hold no leaf share one that is
// empty, so that air costs two bytes a brick. Allocates in the constructor only. Not thread-safe.
class BitOctree {
 public:
  // At most `bricks_max` bricks have leaves at a time (and never more than 65,535).
  explicit BitOctree(const LeafGrid& grid, std::size_t bricks_max = kOctreeBricksMax);

  const LeafGrid& grid() const { return grid_; }
  std::size_t leaf_count() const { return leaf_count_; }

  // True when the leaf was not there before and is now; false also when all bricks are used up
  // (counted by refused()).
  bool insert(LeafAddress address) {
    std::uint64_t& known = words_[place_of(address)];
    const std::uint64_t bit = std::uint64_t{1} << (address & 63);
    if ((known & bit) != 0) return false;
    if (slots_[address >> 9] == kEmptyBrick && !open_brick(address >> 9)) return false;
    words_[place_of(address)] |= bit;
    ++leaf_count_;
    return true;
  }
  // True when the leaf was there.
  bool erase(LeafAddress address);
  bool contains(LeafAddress address) const {
    return ((words_[place_of(address)] >> (address & 63)) & 1) != 0;
  }
  // Clears touched bricks only.
  void clear();

  // The eight words of a brick.
  std::span<const std::uint64_t, 8> brick(BrickAddress brick) const {
    return std::span<const std::uint64_t, 8>(&words_[std::size_t{slots_[brick]} * 8], 8);
  }
  bool brick_occupied(BrickAddress brick) const {
    return ((blocks_[brick >> 6] >> (brick & 63)) & 1) != 0;
  }
  bool block_occupied(std::uint32_t block) const { return blocks_[block] != 0; }
  // The side, in leaves, of the largest empty node that holds this leaf: 32, 8, 4, 2, or 1 when its
  // own 2 x 2 x 2 node has a leaf.
  int empty_node(LeafAddress address) const {
    if (blocks_[address >> 15] == 0) return 32;
    if (!brick_occupied(address >> 9)) return 8;
    const std::uint64_t word = words_[place_of(address)];
    if (word == 0) return 4;
    return ((word >> (address & 56)) & 0xFF) == 0 ? 2 : 1;
  }
  // Every brick that has had a leaf since the last clear(), once each, in the order it got its
  // first; a brick whose leaves were all erased stays until it is cleared.
  std::span<const BrickAddress> touched() const { return touched_.span(); }
  bool is_touched(BrickAddress brick) const {
    return ((listed_[brick >> 6] >> (brick & 63)) & 1) != 0;
  }

  // Calls visit(address) for every leaf, brick by brick in the order of touched().
  template <class Visit>
  void visit(Visit&& visit) const {
    for (const BrickAddress address : touched()) visit_brick(address, visit);
  }
  template <class Visit>
  void visit_brick(BrickAddress address, Visit&& visit) const {
    // Looked up for every word: visit() may have erased the last leaf and with it the brick.
    for (std::uint32_t i = 0; i < 8; ++i) {
      visit_bits(words_[std::size_t{slots_[address]} * 8 + i], address * 512 + i * 64, visit);
    }
  }
  template <class Visit>
  static void visit_bits(std::uint64_t word, LeafAddress first, Visit&& visit) {
    for (; word != 0; word &= word - 1) {
      visit(first + static_cast<std::uint32_t>(std::countr_zero(word)));
    }
  }

  // Bricks that can have leaves at a time, how many had, and inserts that found no room.
  std::size_t capacity() const { return free_slots_.capacity(); }
  std::size_t high_water() const { return high_water_; }
  std::uint64_t refused() const { return refused_; }

 private:
  static constexpr std::uint16_t kEmptyBrick = 0;  // the slot whose words are always zero

  std::size_t place_of(LeafAddress address) const {
    return std::size_t{slots_[address >> 9]} * 8 + ((address >> 6) & 7);
  }
  bool open_brick(BrickAddress brick);
  void close_brick(BrickAddress brick);

  LeafGrid grid_;
  std::unique_ptr<std::uint16_t[]> slots_;  // by brick
  BoundedVector<std::uint16_t> free_slots_;
  FreshArray<std::uint64_t> words_;  // eight a slot
  std::size_t high_water_ = 0;
  std::uint64_t refused_ = 0;
  std::unique_ptr<std::uint64_t[]> blocks_;  // a bit a brick: it has leaves
  std::unique_ptr<std::uint64_t[]> listed_;  // a bit a brick: it is in touched_
  BoundedVector<BrickAddress> touched_;
  std::size_t leaf_count_ = 0;
};

// Kammerl's double-buffered octree (PCL's OctreePointCloudChangeDetector): the leaves of the
// current cloud against those of the one before. XOR of words over bricks that either buffer
// touched.
class ChangeOctree {
 public:
  explicit ChangeOctree(const LeafGrid& grid) : buffers_{BitOctree(grid), BitOctree(grid)} {}

  BitOctree& current() { return buffers_[current_]; }
  const BitOctree& current() const { return buffers_[current_]; }
  BitOctree& previous() { return buffers_[1 - current_]; }
  const BitOctree& previous() const { return buffers_[1 - current_]; }
  // The current cloud becomes the previous one; the new current one is empty.
  void switch_buffers() {
    current_ = 1 - current_;
    buffers_[current_].clear();
  }

  // Calls changed(address) for every leaf that is in exactly one of the two sets.
  template <class Changed>
  void visit_changed(Changed&& changed) const {
    visit_xor(current(), previous(), changed);
  }
  template <class Changed>
  static void visit_xor(const BitOctree& a, const BitOctree& b, Changed&& changed) {
    for (const BrickAddress brick : a.touched()) xor_brick(a, b, brick, changed);
    for (const BrickAddress brick : b.touched()) {
      if (!a.is_touched(brick)) xor_brick(a, b, brick, changed);
    }
  }

 private:
  template <class Changed>
  static void xor_brick(const BitOctree& a, const BitOctree& b, BrickAddress brick,
                        Changed&& changed) {
    const auto words_a = a.brick(brick);
    const auto words_b = b.brick(brick);
    for (std::uint32_t i = 0; i < 8; ++i) {
      BitOctree::visit_bits(words_a[i] ^ words_b[i], brick * 512 + i * 64, changed);
    }
  }

  BitOctree buffers_[2];
  std::size_t current_ = 0;
};

}  // namespace wagonsight
