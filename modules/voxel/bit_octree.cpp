#include "voxel/bit_octree.h"

#include <algorithm>

namespace wagonsight {

BitOctree::BitOctree(const LeafGrid& grid, std::size_t bricks_max)
    : grid_(grid),
      slots_(std::make_unique<std::uint16_t[]>(grid.brick_count())),
      free_slots_(std::min({grid.brick_count(), bricks_max, std::size_t{UINT16_MAX}})),
      words_(make_fresh_array<std::uint64_t>((free_slots_.capacity() + 1) * 8)),
      blocks_(std::make_unique<std::uint64_t[]>(grid.block_count())),
      listed_(std::make_unique<std::uint64_t[]>(grid.block_count())),
      touched_(grid.brick_count()) {
  // Backwards, so that the lowest slots are given out first; 0 is the empty brick.
  for (std::size_t slot = capacity(); slot > 0; --slot) {
    (void)free_slots_.try_push_back(static_cast<std::uint16_t>(slot));
  }
}

bool BitOctree::open_brick(BrickAddress brick) {
  if (free_slots_.empty()) {
    ++refused_;
    return false;
  }
  slots_[brick] = free_slots_[free_slots_.size() - 1];
  free_slots_.resize(free_slots_.size() - 1);
  high_water_ = std::max(high_water_, capacity() - free_slots_.size());
  const std::uint64_t bit = std::uint64_t{1} << (brick & 63);
  blocks_[brick >> 6] |= bit;
  if ((listed_[brick >> 6] & bit) != 0) return true;
  listed_[brick >> 6] |= bit;
  // There is room for every brick of the grid and each is listed once.
  (void)touched_.try_push_back(brick);
  return true;
}

// Its words are zero already.
void BitOctree::close_brick(BrickAddress brick) {
  (void)free_slots_.try_push_back(slots_[brick]);
  slots_[brick] = kEmptyBrick;
  blocks_[brick >> 6] &= ~(std::uint64_t{1} << (brick & 63));
}

bool BitOctree::erase(LeafAddress address) {
  std::uint64_t& word = words_[place_of(address)];
  const std::uint64_t bit = std::uint64_t{1} << (address & 63);
  if ((word & bit) == 0) return false;
  word &= ~bit;
  --leaf_count_;
  const BrickAddress brick_address = address >> 9;
  const auto words = brick(brick_address);
  if (std::all_of(words.begin(), words.end(), [](std::uint64_t w) { return w == 0; })) {
    close_brick(brick_address);
  }
  return true;
}

void BitOctree::clear() {
  for (const BrickAddress brick : touched_.span()) {
    listed_[brick >> 6] = 0;
    if (slots_[brick] == kEmptyBrick) continue;
    std::fill_n(&words_[std::size_t{slots_[brick]} * 8], 8, std::uint64_t{0});
    close_brick(brick);
  }
  touched_.clear();
  leaf_count_ = 0;
}

}  // namespace wagonsight
