#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "base/bounded_vector.h"

namespace wagonsight {

// The mean of the points that fell into one voxel, in the frame the points were given in.
struct VoxelMean {
  float x = 0, y = 0, z = 0;
  std::uint32_t points = 0;
};

// Downsamples points to one mean a voxel. Voxel (i, j, k) is the half-open cube
// [(i, j, k) * voxel_m, + voxel_m) counted from the frame's origin along its axes; a mean is the
// arithmetic mean of its points' offsets from the voxel's corner, in the order they came, so
// nothing is rounded to centres and large coordinates cost no precision. A generation-stamped hash
// of blocks of 4 x 4 x 4 voxels, because the next point is mostly in the same block: clear() costs
// nothing. Allocates in the constructor only. Not thread-safe.
class VoxelGrid {
 public:
  // Holds up to `capacity` voxels at a time, at most 65,535, in up to a quarter as many blocks (a
  // surface has a dozen voxels a block).
  VoxelGrid(std::size_t capacity, double voxel_m);

  // Forgets all voxels.
  void clear();
  // Adds a point (finite, within +-1,000,000 voxels of the origin). False when its voxel is new and
  // there is no room for it.
  bool add(float x, float y, float z) { return add({&x, 1}, {&y, 1}, {&z, 1}) == 0; }
  // Adds points in their order, as many as there are x, y and z; returns how many found no room.
  // Meant for pixels of one row after the other, whose neighbours mostly share a voxel.
  std::size_t add(std::span<const float> x, std::span<const float> y, std::span<const float> z);

  std::size_t size() const { return voxels_.size(); }
  // The voxels in the order in which they got their first point.
  VoxelMean mean(std::size_t index) const;

 private:
  struct Voxel {
    int i = 0, j = 0, k = 0;
    float x = 0, y = 0, z = 0;  // sums of offsets from the voxel's corner, metres
    std::uint32_t points = 0;
  };
  struct BlockKey {
    int i = 0, j = 0, k = 0;
    friend bool operator==(const BlockKey&, const BlockKey&) = default;
  };
  struct Slot {
    BlockKey key;
    std::uint32_t generation = 0;
    std::uint32_t block = 0;
  };
  static constexpr std::size_t kBlockVoxels = 64;

  // The voxels of a block, by place: index + 1, 0 where none is yet. nullptr when all are used.
  std::uint16_t* find_block(const BlockKey& key);
  // The voxel, made when it is new. nullptr when there is no room.
  Voxel* find_voxel(int i, int j, int k);

  float voxel_m_;
  float per_voxel_;
  std::size_t block_capacity_;
  std::size_t slot_mask_;
  FreshArray<Slot> slots_;
  std::size_t block_count_ = 0;
  FreshArray<std::uint16_t> blocks_;
  BoundedVector<Voxel> voxels_;
  std::uint32_t generation_ = 1;
  BlockKey latest_key_;
  std::uint16_t* latest_ = nullptr;  // the block of the last point
};

}  // namespace wagonsight
