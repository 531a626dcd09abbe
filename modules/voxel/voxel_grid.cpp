#include "voxel/voxel_grid.h"

#include <algorithm>
#include <bit>

#include "base/check.h"

namespace wagonsight {
namespace {

// std::floor is a call without SSE 4.1.
inline int floor_of(float value) {
  const int whole = static_cast<int>(value);
  return whole - (static_cast<float>(whole) > value ? 1 : 0);
}

}  // namespace

VoxelGrid::VoxelGrid(std::size_t capacity, double voxel_m)
    : voxel_m_(static_cast<float>(voxel_m)),
      per_voxel_(static_cast<float>(1.0 / voxel_m)),
      block_capacity_(std::min(capacity, std::max<std::size_t>(capacity / 2, 64))),
      // Half full at most, so that a probe is short and ends.
      slot_mask_(std::bit_ceil(block_capacity_ * 2 + 1) - 1),
      slots_(make_fresh_array<Slot>(slot_mask_ + 1)),
      blocks_(std::make_unique_for_overwrite<std::uint32_t[]>(block_capacity_ * kBlockVoxels)),
      voxels_(capacity) {
  WS_CHECK(voxel_m > 0, "voxel of %g m", voxel_m);
}

void VoxelGrid::clear() {
  voxels_.clear();
  block_count_ = 0;
  latest_ = nullptr;
  if (++generation_ == 0) {  // once in four billion frames
    std::fill_n(slots_.get(), slot_mask_ + 1, Slot{});
    generation_ = 1;
  }
}

std::uint32_t* VoxelGrid::find_block(const BlockKey& key) {
  // Teschner et al. 2003, "Optimized spatial hashing"; finished by a multiply to spread low bits.
  const std::uint32_t mixed = static_cast<std::uint32_t>(key.i) * 73856093U ^
                              static_cast<std::uint32_t>(key.j) * 19349663U ^
                              static_cast<std::uint32_t>(key.k) * 83492791U;
  std::size_t place = ((mixed * 0x9E3779B97F4A7C15ULL) >> 32) & slot_mask_;
  for (; slots_[place].generation == generation_; place = (place + 1) & slot_mask_) {
    if (slots_[place].key == key) return &blocks_[slots_[place].block * kBlockVoxels];
  }
  if (block_count_ == block_capacity_) return nullptr;
  slots_[place] = {key, generation_, static_cast<std::uint32_t>(block_count_)};
  std::uint32_t* const block = &blocks_[block_count_++ * kBlockVoxels];
  std::fill_n(block, kBlockVoxels, 0U);
  return block;
}

bool VoxelGrid::add(float x, float y, float z) {
  const int i = floor_of(x * per_voxel_);
  const int j = floor_of(y * per_voxel_);
  const int k = floor_of(z * per_voxel_);
  const BlockKey key{i >> 2, j >> 2, k >> 2};
  if (latest_ == nullptr || !(key == latest_key_)) {
    latest_ = find_block(key);
    latest_key_ = key;
    if (latest_ == nullptr) return false;
  }
  const float dx = x - static_cast<float>(i) * voxel_m_;
  const float dy = y - static_cast<float>(j) * voxel_m_;
  const float dz = z - static_cast<float>(k) * voxel_m_;
  std::uint32_t& known = latest_[static_cast<unsigned>((i & 3) | (j & 3) << 2 | (k & 3) << 4)];
  if (known == 0) {
    if (!voxels_.try_push_back({i, j, k, dx, dy, dz, 1})) return false;
    known = static_cast<std::uint32_t>(voxels_.size());
    return true;
  }
  Voxel& voxel = voxels_[known - 1];
  voxel.x += dx;
  voxel.y += dy;
  voxel.z += dz;
  ++voxel.points;
  return true;
}

VoxelMean VoxelGrid::mean(std::size_t index) const {
  const Voxel& voxel = voxels_[index];
  const float share = 1.0F / static_cast<float>(voxel.points);
  return {static_cast<float>(voxel.i) * voxel_m_ + voxel.x * share,
          static_cast<float>(voxel.j) * voxel_m_ + voxel.y * share,
          static_cast<float>(voxel.k) * voxel_m_ + voxel.z * share, voxel.points};
}

}  // namespace wagonsight
