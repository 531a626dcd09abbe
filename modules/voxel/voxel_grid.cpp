#include "voxel/voxel_grid.h"

#include <algorithm>
#include <array>
#include <bit>

#include "base/check.h"

namespace wagonsight {
namespace {

// Points are cut into voxels so many at a time.
constexpr std::size_t kTogether = 128;

// The voxels along one axis that hold `at`, and how far behind the voxel's corner each is. A plain
// loop that the compiler turns into four or eight at a time; std::floor is a call without SSE 4.1.
void cut(const float* at, std::size_t count, float voxel_m, float per_voxel, int* voxel,
         float* beyond) {
  for (std::size_t p = 0; p < count; ++p) {
    const float scaled = at[p] * per_voxel;
    int whole = static_cast<int>(scaled);
    whole -= static_cast<float>(whole) > scaled ? 1 : 0;
    voxel[p] = whole;
    beyond[p] = at[p] - static_cast<float>(whole) * voxel_m;
  }
}

}  // namespace

VoxelGrid::VoxelGrid(std::size_t capacity, double voxel_m)
    : voxel_m_(static_cast<float>(voxel_m)),
      per_voxel_(static_cast<float>(1.0 / voxel_m)),
      block_capacity_(std::min(capacity, std::max<std::size_t>(capacity / 4, 64))),
      // Half full at most, so that a probe is short and ends.
      slot_mask_(std::bit_ceil(block_capacity_ * 2) - 1),
      slots_(make_fresh_array<Slot>(slot_mask_ + 1)),
      blocks_(make_fresh_array<std::uint16_t>(block_capacity_ * kBlockVoxels)),
      voxels_(capacity) {
  WS_CHECK(voxel_m > 0, "voxel of %g m", voxel_m);
  WS_CHECK(capacity <= UINT16_MAX, "%zu voxels", capacity);
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

std::uint16_t* VoxelGrid::find_block(const BlockKey& key) {
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
  std::uint16_t* const block = &blocks_[block_count_++ * kBlockVoxels];
  std::fill_n(block, kBlockVoxels, std::uint16_t{0});
  return block;
}

VoxelGrid::Voxel* VoxelGrid::find_voxel(int i, int j, int k) {
  const BlockKey key{i >> 2, j >> 2, k >> 2};
  if (latest_ == nullptr || !(key == latest_key_)) {
    latest_ = find_block(key);
    latest_key_ = key;
    if (latest_ == nullptr) return nullptr;
  }
  std::uint16_t& known = latest_[static_cast<unsigned>((i & 3) | (j & 3) << 2 | (k & 3) << 4)];
  if (known == 0) {
    if (!voxels_.try_push_back({i, j, k, 0, 0, 0, 0})) return nullptr;
    known = static_cast<std::uint16_t>(voxels_.size());
  }
  return &voxels_[known - 1U];
}

std::size_t VoxelGrid::add(std::span<const float> x, std::span<const float> y,
                           std::span<const float> z) {
  std::array<int, kTogether> i, j, k;
  std::array<float, kTogether> dx, dy, dz;
  std::size_t refused = 0;
  Voxel* open = nullptr;  // the voxel of the point before; its sums are in registers meanwhile
  Voxel sums;
  for (std::size_t first = 0; first < x.size(); first += kTogether) {
    const std::size_t count = std::min(kTogether, x.size() - first);
    cut(&x[first], count, voxel_m_, per_voxel_, i.data(), dx.data());
    cut(&y[first], count, voxel_m_, per_voxel_, j.data(), dy.data());
    cut(&z[first], count, voxel_m_, per_voxel_, k.data(), dz.data());
    for (std::size_t p = 0; p < count; ++p) {
      if (open == nullptr || i[p] != sums.i || j[p] != sums.j || k[p] != sums.k) {
        if (open != nullptr) *open = sums;
        open = find_voxel(i[p], j[p], k[p]);
        if (open == nullptr) {
          ++refused;
          continue;
        }
        sums = *open;
      }
      sums.x += dx[p];
      sums.y += dy[p];
      sums.z += dz[p];
      ++sums.points;
    }
  }
  if (open != nullptr) *open = sums;
  return refused;
}

VoxelMean VoxelGrid::mean(std::size_t index) const {
  const Voxel& voxel = voxels_[index];
  const float share = 1.0F / static_cast<float>(voxel.points);
  return {static_cast<float>(voxel.i) * voxel_m_ + voxel.x * share,
          static_cast<float>(voxel.j) * voxel_m_ + voxel.y * share,
          static_cast<float>(voxel.k) * voxel_m_ + voxel.z * share, voxel.points};
}

}  // namespace wagonsight
