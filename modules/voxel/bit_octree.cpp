#include "voxel/bit_octree.h"

#include <algorithm>

namespace wagonsight {

BitOctree::BitOctree(const LeafGrid& grid)
    : grid_(grid),
      words_(make_fresh_array<std::uint64_t>(grid.brick_count() * 8)),
      blocks_(std::make_unique<std::uint64_t[]>(grid.block_count())),
      listed_(std::make_unique<std::uint64_t[]>(grid.block_count())),
      touched_(grid.brick_count()) {}

void BitOctree::mark(BrickAddress brick) {
  const std::uint64_t bit = std::uint64_t{1} << (brick & 63);
  blocks_[brick >> 6] |= bit;
  if ((listed_[brick >> 6] & bit) != 0) return;
  listed_[brick >> 6] |= bit;
  // There is room for every brick of the grid and each is listed once.
  (void)touched_.try_push_back(brick);
}

bool BitOctree::erase(LeafAddress address) {
  std::uint64_t& word = words_[address >> 6];
  const std::uint64_t bit = std::uint64_t{1} << (address & 63);
  if ((word & bit) == 0) return false;
  word &= ~bit;
  --leaf_count_;
  const BrickAddress brick_address = address >> 9;
  const auto words = brick(brick_address);
  if (std::all_of(words.begin(), words.end(), [](std::uint64_t w) { return w == 0; })) {
    blocks_[brick_address >> 6] &= ~(std::uint64_t{1} << (brick_address & 63));
  }
  return true;
}

void BitOctree::clear() {
  for (const BrickAddress brick : touched_.span()) {
    std::fill_n(&words_[std::size_t{brick} * 8], 8, std::uint64_t{0});
    blocks_[brick >> 6] = 0;
    listed_[brick >> 6] = 0;
  }
  touched_.clear();
  leaf_count_ = 0;
}

}  // namespace wagonsight
