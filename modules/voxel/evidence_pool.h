#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>

#include "base/bounded_vector.h"
#include "voxel/leaf_grid.h"

namespace wagonsight {

// What was observed of one leaf: how often something was in it and how often it was seen through.
struct LeafEvidence {
  std::uint8_t hits = 0;
  std::uint8_t frees = 0;
};

// Evidence for those leaves that anything was ever observed in: a fixed number of bricks of
// counters, given out when a brick is first written and taken back when it is forgotten. Beside its
// counters each leaf remembers whether it was seen in this round and in the one before (rounds are
// numbered by the caller): two sets of leaves in two buffers of bits, as Kammerl's octree has, but
// only of bricks that matter. Allocates in the constructor only.
class EvidencePool {
 public:
  // At most `bricks_max` bricks, and never more than the grid has.
  explicit EvidencePool(const LeafGrid& grid, std::size_t bricks_max = kEvidenceBricksMax);

  // The evidence of a leaf, or nullptr: nothing was observed there.
  LeafEvidence* find(LeafAddress address) {
    const std::uint32_t slot = slots_[address >> 9];
    return slot == kNoSlot ? nullptr : &leaves_[std::size_t{slot} * kBrickLeaves + (address & 511)];
  }
  const LeafEvidence* find(LeafAddress address) const {
    return const_cast<EvidencePool*>(this)->find(address);
  }
  // The evidence of a leaf, its brick fetched from the pool when it is new; nullptr when the pool
  // is used up (counted by refused()).
  LeafEvidence* find_or_add(LeafAddress address);
  // Marks a leaf that has evidence as seen in `round`, which never falls; true when it was not yet.
  bool see(LeafAddress address, std::uint32_t round);
  // Whether a leaf that has evidence was seen in `round`, or in it or the round before.
  bool seen(LeafAddress address, std::uint32_t round) const;
  bool seen_lately(LeafAddress address, std::uint32_t round) const;
  // Bricks that have evidence, in no particular but a deterministic order.
  std::span<const BrickAddress> bricks() const { return bricks_.span(); }
  // The counters of a brick that has evidence.
  std::span<LeafEvidence, kBrickLeaves> brick(BrickAddress brick);
  void forget(BrickAddress brick);
  void clear();

  std::size_t capacity() const { return capacity_; }
  std::size_t high_water() const { return bricks_.high_water(); }
  std::uint64_t refused() const { return refused_; }

 private:
  static constexpr std::uint32_t kNoSlot = UINT32_MAX;

  struct Sight {
    std::array<std::uint64_t, kBrickLeaves / 64> now{}, before{};  // seen in `round`, in round - 1
    std::uint32_t round = 0;
  };
  // The brick's sets as of `round`.
  Sight& sight(LeafAddress address, std::uint32_t round);

  std::size_t capacity_;
  std::unique_ptr<std::uint32_t[]> slots_;   // by brick
  std::unique_ptr<std::uint32_t[]> places_;  // by brick: where in bricks_
  FreshArray<LeafEvidence> leaves_;          // by slot
  FreshArray<Sight> sights_;                 // by slot
  BoundedVector<std::uint32_t> free_slots_;
  BoundedVector<BrickAddress> bricks_;
  std::uint64_t refused_ = 0;
};

}  // namespace wagonsight
