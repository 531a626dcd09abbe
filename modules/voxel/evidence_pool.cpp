#include "voxel/evidence_pool.h"

#include <algorithm>

#include "base/check.h"

namespace wagonsight {
namespace {

// Backwards, so that the lowest are given out first.
void fill_free(BoundedVector<std::uint32_t>& free) {
  for (std::size_t i = free.capacity(); i > 0; --i) {
    (void)free.try_push_back(static_cast<std::uint32_t>(i - 1));
  }
}

std::uint32_t take_last(BoundedVector<std::uint32_t>& free) {
  const std::uint32_t last = free[free.size() - 1];
  free.resize(free.size() - 1);
  return last;
}

}  // namespace

EvidencePool::EvidencePool(const LeafGrid& grid, std::size_t nodes_max)
    : slots_(std::make_unique<std::uint32_t[]>(grid.brick_count())),
      bricks_(std::min(grid.brick_count(), std::max<std::size_t>(nodes_max / 2, 1))),
      slot_bricks_(make_fresh_array<Brick>(bricks_.capacity())),
      nodes_(make_fresh_array<Node>(std::min(bricks_.capacity() * kBrickNodes, nodes_max))),
      free_slots_(bricks_.capacity()),
      free_nodes_(std::min(bricks_.capacity() * kBrickNodes, nodes_max)) {
  std::fill_n(slots_.get(), grid.brick_count(), kNone);
  fill_free(free_slots_);
  fill_free(free_nodes_);
}

bool EvidencePool::add_brick(BrickAddress brick) {
  if (free_slots_.empty()) return false;
  const std::uint32_t slot = take_last(free_slots_);
  slots_[brick] = slot;
  slot_bricks_[slot].nodes.fill(kNone);
  slot_bricks_[slot].place = static_cast<std::uint32_t>(bricks_.size());
  return bricks_.try_push_back(brick);  // there is room for as many as there are slots
}

LeafEvidence* EvidencePool::find_or_add(LeafAddress address) {
  if (LeafEvidence* known = find(address)) return known;
  const auto brick = static_cast<BrickAddress>(address / kBrickLeaves);
  if (free_nodes_.empty() || (slots_[brick] == kNone && !add_brick(brick))) {
    ++refused_;
    return nullptr;
  }
  const std::uint32_t node = take_last(free_nodes_);
  high_water_ = std::max(high_water_, capacity() - free_nodes_.size());
  slot_bricks_[slots_[brick]].nodes[address / kNodeLeaves % kBrickNodes] = node;
  nodes_[node] = {};
  return &nodes_[node].leaves[address % kNodeLeaves];
}

EvidencePool::Node& EvidencePool::node_at(LeafAddress address, std::uint32_t round) {
  Node* const node = node_of(address);
  WS_CHECK(node != nullptr, "leaf %u has no evidence", address);
  if (node->round == round) return *node;
  node->before = node->round + 1 == round ? node->now : 0;
  node->now = 0;
  node->round = round;
  return *node;
}

bool EvidencePool::see(LeafAddress address, std::uint32_t round) {
  Node& node = node_at(address, round);
  const std::uint64_t bit = std::uint64_t{1} << (address % kNodeLeaves);
  const bool is_new = (node.now & bit) == 0;
  node.now |= bit;
  return is_new;
}

bool EvidencePool::seen(LeafAddress address, std::uint32_t round) const {
  const Node* const node = node_of(address);
  return node != nullptr && node->round == round &&
         ((node->now >> (address % kNodeLeaves)) & 1) != 0;
}

bool EvidencePool::seen_lately(LeafAddress address, std::uint32_t round) const {
  const Node* const node = node_of(address);
  if (node == nullptr) return false;
  std::uint64_t seen = 0;
  if (node->round == round) seen = node->now | node->before;
  if (node->round + 1 == round) seen = node->now;
  return ((seen >> (address % kNodeLeaves)) & 1) != 0;
}

void EvidencePool::forget(BrickAddress brick) {
  const std::uint32_t slot = slots_[brick];
  if (slot == kNone) return;
  for (const std::uint32_t node : slot_bricks_[slot].nodes) {
    if (node != kNone) (void)free_nodes_.try_push_back(node);
  }
  (void)free_slots_.try_push_back(slot);
  slots_[brick] = kNone;
  const BrickAddress last = bricks_[bricks_.size() - 1];
  bricks_[slot_bricks_[slot].place] = last;
  if (last != brick) slot_bricks_[slots_[last]].place = slot_bricks_[slot].place;
  bricks_.resize(bricks_.size() - 1);
}

void EvidencePool::clear() {
  while (!bricks_.empty()) forget(bricks_[bricks_.size() - 1]);
}

}  // namespace wagonsight
