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

// Evidence for those leaves that anything was ever observed in. A surface passes through few of a
// brick's eight nodes of 4 x 4 x 4 leaves, so counters come from a fixed number of nodes, given out
// when one is first written and taken back when its brick is forgotten. Beside its counters each
// leaf remembers whether it was seen in this round and in the one before (rounds are numbered by
// the caller): two sets of leaves in two buffers of bits, as Kammerl's octree has, but only where
// it matters. Allocates in the constructor only.
class EvidencePool {
 public:
  static constexpr std::uint32_t kNodeLeaves = 64;

  // At most `nodes_max` nodes in at most half as many bricks, and never more than the grid has.
  explicit EvidencePool(const LeafGrid& grid, std::size_t nodes_max = kEvidenceNodesMax);

  // The evidence of a leaf, or nullptr: nothing was observed there or beside it.
  LeafEvidence* find(LeafAddress address) {
    Node* const node = node_of(address);
    return node == nullptr ? nullptr : &node->leaves[address % kNodeLeaves];
  }
  const LeafEvidence* find(LeafAddress address) const {
    return const_cast<EvidencePool*>(this)->find(address);
  }
  // The evidence of a leaf, its node fetched from the pool when it is new; nullptr when the pool
  // is used up (counted by refused()).
  LeafEvidence* find_or_add(LeafAddress address);
  // Marks a leaf that has evidence as seen in `round`, which never falls; true when it was not yet.
  bool see(LeafAddress address, std::uint32_t round);
  // Whether a leaf that has evidence was seen in `round`, or in it or the round before.
  bool seen(LeafAddress address, std::uint32_t round) const;
  bool seen_lately(LeafAddress address, std::uint32_t round) const;
  // Bricks that have evidence, in no particular but a deterministic order.
  std::span<const BrickAddress> bricks() const { return bricks_.span(); }
  // Calls visit(leaf address, LeafEvidence&) for the leaves of a brick's nodes, in their order.
  template <class Visit>
  void visit_brick(BrickAddress brick, Visit&& visit) {
    for (std::uint32_t i = 0; i < kBrickNodes; ++i) {
      const LeafAddress first = brick * static_cast<std::uint32_t>(kBrickLeaves) + i * kNodeLeaves;
      Node* const node = node_of(first);
      if (node == nullptr) continue;
      for (std::uint32_t k = 0; k < kNodeLeaves; ++k) visit(first + k, node->leaves[k]);
    }
  }
  void forget(BrickAddress brick);
  void clear();

  // Nodes: how many there are, and how many were in use at the most.
  std::size_t capacity() const { return free_nodes_.capacity(); }
  std::size_t high_water() const { return high_water_; }
  std::size_t brick_capacity() const { return bricks_.capacity(); }
  std::uint64_t refused() const { return refused_; }

 private:
  static constexpr std::uint32_t kBrickNodes = kBrickLeaves / kNodeLeaves;
  static constexpr std::uint32_t kNone = UINT32_MAX;

  struct Node {
    std::uint64_t now = 0, before = 0;  // leaves seen in `round`, in round - 1
    std::uint32_t round = 0;
    std::array<LeafEvidence, kNodeLeaves> leaves{};
  };
  struct Brick {
    std::array<std::uint32_t, kBrickNodes> nodes{};
    std::uint32_t place = 0;  // in bricks_
  };

  Node* node_of(LeafAddress address) {
    const std::uint32_t slot = slots_[address / kBrickLeaves];
    if (slot == kNone) return nullptr;
    const std::uint32_t node = slot_bricks_[slot].nodes[address / kNodeLeaves % kBrickNodes];
    return node == kNone ? nullptr : &nodes_[node];
  }
  const Node* node_of(LeafAddress address) const {
    return const_cast<EvidencePool*>(this)->node_of(address);
  }
  bool add_brick(BrickAddress brick);
  // The leaf's node with its sets as of `round`.
  Node& node_at(LeafAddress address, std::uint32_t round);

  std::unique_ptr<std::uint32_t[]> slots_;  // by brick
  BoundedVector<BrickAddress> bricks_;
  FreshArray<Brick> slot_bricks_;
  FreshArray<Node> nodes_;
  BoundedVector<std::uint32_t> free_slots_, free_nodes_;
  std::size_t high_water_ = 0;
  std::uint64_t refused_ = 0;
};

}  // namespace wagonsight
