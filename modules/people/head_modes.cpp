#include "people/head_modes.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

// Points more exact than this do not count more: metres.
constexpr float kSigmaFloor = 0.015F;
constexpr float kModeShareMin = 0.33F;
constexpr float kApartMin = 0.20F;  // metres, between two heads that touch

}  // namespace

void HeadModes::clear(float centre_x, float centre_y) {
  min_x_ = centre_x - 0.5F * kSide * kCell;
  min_y_ = centre_y - 0.5F * kSide * kCell;
  density_.fill(0);
}

void HeadModes::add(const FusedPoint& point) {
  const int column = static_cast<int>(std::floor((point.x - min_x_) / kCell));
  const int row = static_cast<int>(std::floor((point.y - min_y_) / kCell));
  if (column < 0 || row < 0 || column >= kSide || row >= kSide) return;
  density_[static_cast<std::size_t>(row * kSide + column)] +=
      point.area_m2 / (point.sigma * point.sigma + kSigmaFloor * kSigmaFloor);
}

float HeadModes::at(int column, int row) const {
  if (column < 0 || row < 0 || column >= kSide || row >= kSide) return 0;
  return density_[static_cast<std::size_t>(row * kSide + column)];
}

// Two passes of 1-2-1 along each axis: a standard deviation of one cell.
void HeadModes::smooth() {
  for (int pass = 0; pass < 2; ++pass) {
    for (int row = 0; row < kSide; ++row)
      for (int column = 0; column < kSide; ++column)
        scratch_[static_cast<std::size_t>(row * kSide + column)] =
            0.25F * at(column - 1, row) + 0.5F * at(column, row) + 0.25F * at(column + 1, row);
    std::swap(density_, scratch_);
    for (int row = 0; row < kSide; ++row)
      for (int column = 0; column < kSide; ++column)
        scratch_[static_cast<std::size_t>(row * kSide + column)] =
            0.25F * at(column, row - 1) + 0.5F * at(column, row) + 0.25F * at(column, row + 1);
    std::swap(density_, scratch_);
  }
}

float HeadModes::density_between(const HeadMode& a, const HeadMode& b) const {
  float lowest = std::min(a.weight, b.weight);
  constexpr int kSteps = 12;
  for (int i = 1; i < kSteps; ++i) {
    const float share = static_cast<float>(i) / kSteps;
    const float x = a.x + share * (b.x - a.x);
    const float y = a.y + share * (b.y - a.y);
    lowest = std::min(lowest, at(static_cast<int>(std::floor((x - min_x_) / kCell)),
                                 static_cast<int>(std::floor((y - min_y_) / kCell))));
  }
  return lowest;
}

std::span<const HeadMode> HeadModes::find(float gap) {
  smooth();
  FixedVector<HeadMode, 128> maxima;
  for (int row = 0; row < kSide; ++row)
    for (int column = 0; column < kSide; ++column) {
      const float here = at(column, row);
      bool highest = here > 0;
      for (int dy = -1; dy <= 1 && highest; ++dy)
        for (int dx = -1; dx <= 1 && highest; ++dx) {
          const bool before = dy < 0 || (dy == 0 && dx < 0);  // a plateau has one maximum
          const float there = at(column + dx, row + dy);
          if (dx != 0 || dy != 0) highest = before ? here > there : here >= there;
        }
      if (!highest) continue;
      const HeadMode mode{min_x_ + (static_cast<float>(column) + 0.5F) * kCell,
                          min_y_ + (static_cast<float>(row) + 0.5F) * kCell, here};
      if (!maxima.try_push_back(mode)) break;
    }
  std::sort(maxima.begin(), maxima.end(),
            [](const HeadMode& a, const HeadMode& b) { return a.weight > b.weight; });
  modes_.clear();
  for (const HeadMode& mode : maxima) {
    if (mode.weight < kModeShareMin * maxima[0].weight) break;
    bool apart = true;
    for (const HeadMode& other : modes_)
      apart = apart && std::hypot(mode.x - other.x, mode.y - other.y) >= kApartMin &&
              density_between(mode, other) < gap * mode.weight;
    if (apart && !modes_.try_push_back(mode)) break;
  }
  return {modes_.data(), modes_.size()};
}

}  // namespace wagonsight
