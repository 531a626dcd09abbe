#include "voxel/evidence_pool.h"

#include <algorithm>

#include "base/check.h"

namespace wagonsight {

EvidencePool::EvidencePool(const LeafGrid& grid, std::size_t bricks_max)
    : capacity_(std::min(grid.brick_count(), bricks_max)),
      slots_(std::make_unique<std::uint32_t[]>(grid.brick_count())),
      places_(std::make_unique<std::uint32_t[]>(grid.brick_count())),
      leaves_(make_fresh_array<LeafEvidence>(capacity_ * kBrickLeaves)),
      sights_(make_fresh_array<Sight>(capacity_)),
      free_slots_(capacity_),
      bricks_(capacity_) {
  std::fill_n(slots_.get(), grid.brick_count(), kNoSlot);
  // Backwards, so that the lowest slots are given out first.
  for (std::size_t slot = capacity_; slot > 0; --slot) {
    (void)free_slots_.try_push_back(static_cast<std::uint32_t>(slot - 1));
  }
}

LeafEvidence* EvidencePool::find_or_add(LeafAddress address) {
  if (LeafEvidence* known = find(address)) return known;
  if (free_slots_.empty()) {
    ++refused_;
    return nullptr;
  }
  const BrickAddress brick_address = address >> 9;
  const std::uint32_t slot = free_slots_[free_slots_.size() - 1];
  free_slots_.resize(free_slots_.size() - 1);
  slots_[brick_address] = slot;
  places_[brick_address] = static_cast<std::uint32_t>(bricks_.size());
  (void)bricks_.try_push_back(brick_address);
  std::fill_n(&leaves_[std::size_t{slot} * kBrickLeaves], kBrickLeaves, LeafEvidence{});
  sights_[slot] = {};
  return find(address);
}

EvidencePool::Sight& EvidencePool::sight(LeafAddress address, std::uint32_t round) {
  Sight& sight = sights_[slots_[address >> 9]];
  if (sight.round == round) return sight;
  sight.before = sight.round + 1 == round ? sight.now : decltype(sight.before){};
  sight.now = {};
  sight.round = round;
  return sight;
}

bool EvidencePool::see(LeafAddress address, std::uint32_t round) {
  std::uint64_t& word = sight(address, round).now[(address & 511) / 64];
  const std::uint64_t bit = std::uint64_t{1} << (address & 63);
  const bool is_new = (word & bit) == 0;
  word |= bit;
  return is_new;
}

bool EvidencePool::seen(LeafAddress address, std::uint32_t round) const {
  const Sight& sight = sights_[slots_[address >> 9]];
  return sight.round == round && ((sight.now[(address & 511) / 64] >> (address & 63)) & 1) != 0;
}

bool EvidencePool::seen_lately(LeafAddress address, std::uint32_t round) const {
  const Sight& sight = sights_[slots_[address >> 9]];
  const std::size_t word = (address & 511) / 64;
  std::uint64_t seen = 0;
  if (sight.round == round) seen = sight.now[word] | sight.before[word];
  if (sight.round + 1 == round) seen = sight.now[word];
  return ((seen >> (address & 63)) & 1) != 0;
}

std::span<LeafEvidence, kBrickLeaves> EvidencePool::brick(BrickAddress brick) {
  WS_CHECK(slots_[brick] != kNoSlot, "brick %u has no evidence", brick);
  return std::span<LeafEvidence, kBrickLeaves>(&leaves_[std::size_t{slots_[brick]} * kBrickLeaves],
                                               kBrickLeaves);
}

void EvidencePool::forget(BrickAddress brick) {
  if (slots_[brick] == kNoSlot) return;
  (void)free_slots_.try_push_back(slots_[brick]);
  slots_[brick] = kNoSlot;
  const BrickAddress last = bricks_[bricks_.size() - 1];
  bricks_[places_[brick]] = last;
  places_[last] = places_[brick];
  bricks_.resize(bricks_.size() - 1);
}

void EvidencePool::clear() {
  while (!bricks_.empty()) forget(bricks_[bricks_.size() - 1]);
}

}  // namespace wagonsight
