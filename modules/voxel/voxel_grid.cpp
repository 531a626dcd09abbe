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
      // Half full at most, so that a probe is short.
      slot_mask_(std::bit_ceil(std::max<std::size_t>(capacity, 1) * 2) - 1),
      slots_(std::make_unique<Slot[]>(slot_mask_ + 1)),
      voxels_(capacity) {
  WS_CHECK(voxel_m > 0, "voxel of %g m", voxel_m);
}

void VoxelGrid::clear() {
  voxels_.clear();
  if (++generation_ == 0) {  // once in four billion frames
    std::fill_n(slots_.get(), slot_mask_ + 1, Slot{});
    generation_ = 1;
  }
}

bool VoxelGrid::add(float x, float y, float z) {
  const int i = floor_of(x * per_voxel_);
  const int j = floor_of(y * per_voxel_);
  const int k = floor_of(z * per_voxel_);
  const float dx = x - static_cast<float>(i) * voxel_m_;
  const float dy = y - static_cast<float>(j) * voxel_m_;
  const float dz = z - static_cast<float>(k) * voxel_m_;
  const auto join = [&](Voxel& voxel) {
    voxel.x += dx;
    voxel.y += dy;
    voxel.z += dz;
    ++voxel.points;
    return true;
  };
  // Neighbouring pixels mostly share a voxel.
  if (latest_ < voxels_.size()) {
    Voxel& voxel = voxels_[latest_];
    if (voxel.i == i && voxel.j == j && voxel.k == k) return join(voxel);
  }
  // Teschner et al. 2003, "Optimized spatial hashing"; finished by a multiply to spread low bits.
  const std::uint32_t mixed = static_cast<std::uint32_t>(i) * 73856093U ^
                              static_cast<std::uint32_t>(j) * 19349663U ^
                              static_cast<std::uint32_t>(k) * 83492791U;
  std::size_t place = ((mixed * 0x9E3779B97F4A7C15ULL) >> 32) & slot_mask_;
  while (slots_[place].generation == generation_) {
    Voxel& voxel = voxels_[slots_[place].index];
    if (voxel.i == i && voxel.j == j && voxel.k == k) {
      latest_ = slots_[place].index;
      return join(voxel);
    }
    place = (place + 1) & slot_mask_;
  }
  const auto index = static_cast<std::uint32_t>(voxels_.size());
  if (!voxels_.try_push_back({i, j, k, dx, dy, dz, 1})) {
    return false;
  }
  latest_ = index;
  slots_[place] = {generation_, index};
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
