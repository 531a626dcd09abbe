#include "simulate/noise_field.h"

#include <array>
#include <cmath>

#include "simulate/random.h"

namespace wagonsight {
namespace {

constexpr int kCoarse = 8;  // lattice cells in a coarse cell: 64 pixels

// The sum of four uniform bytes: nearly normal, mean 0 and variance 1.
float normal_of(std::uint32_t bits) {
  const std::uint32_t sum =
      (bits & 255U) + (bits >> 8U & 255U) + (bits >> 16U & 255U) + (bits >> 24U);
  return (static_cast<float>(sum) - 510.0F) * (1.0F / 147.8F);
}

// Linear interpolation in two directions averages; this undoes what it takes from the variance:
// the mean of (1-t)^2 + t^2 over a cell is 2/3 in each direction.
constexpr float kFineGain = 1.5F;

// Linear interpolation, kCount values between two nodes.
template <int kCount>
void spread(std::span<const float> nodes, std::span<float> values) {
  for (std::size_t c = 0; c + 1 < nodes.size(); ++c) {
    const float left = nodes[c], slope = (nodes[c + 1] - left) * (1.0F / kCount);
    float* cell = values.data() + c * kCount;
    for (int k = 0; k < kCount; ++k) cell[k] = left + slope * static_cast<float>(k);
  }
}

}  // namespace

NoiseField::NoiseField(int width, int height, double coarse_share, int every)
    : width_(width / every),
      per_cell_(kCell / every),
      columns_(width / kCell + 3),
      rows_(height / kCell + 3),
      fine_weight_(kFineGain * static_cast<float>(std::sqrt(1 - coarse_share))),
      coarse_weight_(kFineGain * static_cast<float>(std::sqrt(coarse_share))),
      nodes_(static_cast<std::size_t>(columns_ * rows_)),
      line_(static_cast<std::size_t>(columns_)),
      values_(static_cast<std::size_t>(columns_ * per_cell_)) {}

void NoiseField::draw(std::uint64_t seed) {
  const std::uint64_t shift = mixed(seed, 0x51F7);
  shift_u_ = static_cast<int>(shift & 7U) * per_cell_ / kCell;
  shift_v_ = static_cast<int>(shift >> 8U & 7U);
  const auto coarse = [&](int column, int row) {
    return normal_of(static_cast<std::uint32_t>(
        mixed(seed ^ 0xC0A5E, static_cast<std::uint64_t>(row * 1024 + column))));
  };
  for (int r = 0; r < rows_; ++r) {
    const float fr = static_cast<float>(r % kCoarse) / kCoarse;
    float* line = nodes_.data() + static_cast<std::ptrdiff_t>(r) * columns_;
    for (int c = 0; c < columns_; c += 2) {
      const std::uint64_t bits = mixed(seed + static_cast<std::uint64_t>(r * 1024 + c) * 0x9E37U);
      line[c] = fine_weight_ * normal_of(static_cast<std::uint32_t>(bits));
      if (c + 1 < columns_)
        line[c + 1] = fine_weight_ * normal_of(static_cast<std::uint32_t>(bits >> 32U));
    }
    if (coarse_weight_ <= 0) continue;
    for (int c0 = 0; c0 < columns_; c0 += kCoarse) {
      const int i = c0 / kCoarse, j = r / kCoarse;
      const float left = coarse(i, j) + fr * (coarse(i, j + 1) - coarse(i, j));
      const float right = coarse(i + 1, j) + fr * (coarse(i + 1, j + 1) - coarse(i + 1, j));
      for (int k = 0; k < kCoarse && c0 + k < columns_; ++k)
        line[c0 + k] += coarse_weight_ * (left + (right - left) * static_cast<float>(k) / kCoarse);
    }
  }
}

std::span<const float> NoiseField::row(int v) {
  const int at = v + shift_v_;
  const float share = static_cast<float>(at % kCell) / kCell;
  const float* above = nodes_.data() + static_cast<std::ptrdiff_t>(at / kCell) * columns_;
  const float* below = above + columns_;
  for (std::size_t c = 0; c < line_.size(); ++c)
    line_[c] = above[c] + share * (below[c] - above[c]);
  if (per_cell_ == kCell) {  // a loop of known length is unrolled and vectorised
    spread<kCell>(line_, values_);
  } else {
    spread<kCell / 4>(line_, values_);
  }
  return {values_.data() + shift_u_, static_cast<std::size_t>(width_)};
}

}  // namespace wagonsight
