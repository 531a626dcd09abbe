#include <algorithm>
#include <cstdlib>

#include "stereo/matcher.h"

// The steps of one row of the matcher, from gray values to a checked disparity.
namespace wagonsight {

using stereo_kernels::kCensusReach;
using stereo_kernels::kDisparitiesMax;
using stereo_kernels::kLanes;

namespace {

// Gray levels of an 8-bit image count sixteenfold, so that both formats are 12-bit ones.
std::uint16_t gray_at(const GrayImage& image, std::size_t index) {
  if (image.format == PixelFormat::kGray8)
    return static_cast<std::uint16_t>(static_cast<const std::uint8_t*>(image.pixels)[index] << 4);
  return std::min<std::uint16_t>(static_cast<const std::uint16_t*>(image.pixels)[index], 32767);
}

// out[i] = gray of column `first + i * step` of the row, columns clamped to the image, for i in
// [begin, end).
void copy_grays(const GrayImage& image, int y, int first, int step, int begin, int end,
                std::uint16_t* out) {
  const std::size_t row = static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width);
  const auto inside = [&](int i) {
    const int x = first + i * step;
    return x >= 0 && x < image.width;
  };
  const auto clamped = [&](int i) {
    return gray_at(
        image, row + static_cast<std::size_t>(std::clamp(first + i * step, 0, image.width - 1)));
  };
  while (begin < end && !inside(begin)) out[begin] = clamped(begin), ++begin;
  while (end > begin && !inside(end - 1)) out[end - 1] = clamped(end - 1), --end;
  const auto copy = [&](const auto* pixels, auto convert) {
    const auto* source = pixels + row;
    if (step > 0)
      for (int i = begin; i < end; ++i) out[i] = convert(source[first + i]);
    else
      for (int i = begin; i < end; ++i) out[i] = convert(source[first - i]);
  };
  if (image.format == PixelFormat::kGray8)
    copy(static_cast<const std::uint8_t*>(image.pixels),
         [](std::uint8_t v) { return static_cast<std::uint16_t>(v << 4); });
  else
    copy(static_cast<const std::uint16_t*>(image.pixels),
         [](std::uint16_t v) { return std::min<std::uint16_t>(v, 32767); });
}

}  // namespace

// The guide's gray levels are relative to the image's mean, so that an edge is an edge in a tunnel
// too; a mean below 64 of 4095 counts as 64, where noise would be the edges.
void StereoMatcher::measure_brightness(const GrayImage& left) {
  constexpr int kRowStep = 8;
  constexpr std::uint64_t kMeanLeast = 64, kGuideMean = 110;
  std::uint64_t sum = 0, count = 0;
  for (int y = 0; y < height_; y += kRowStep) {
    const std::size_t row = static_cast<std::size_t>(y) * static_cast<std::size_t>(width_);
    std::uint32_t row_sum = 0;
    for (int x = 0; x < width_; ++x) row_sum += gray_at(left, row + static_cast<std::size_t>(x));
    sum += row_sum;
    count += static_cast<std::uint64_t>(width_);
  }
  const std::uint64_t mean = std::max(sum / count, kMeanLeast);
  guide_gain_ = static_cast<std::uint32_t>((kGuideMean << 16) / mean);
}

std::uint16_t* StereoMatcher::gray_row(AlignedArray<std::uint16_t>& ring, int y) {
  return ring.data() + static_cast<std::size_t>(y % kGrayRows) * gray_stride_ + kLanes;
}

std::uint8_t* StereoMatcher::raw_row(int y) {
  return raw_.data() + static_cast<std::size_t>(y % kRawRows) * cost_stride_;
}

std::size_t StereoMatcher::ring_slot(int y) const {
  return static_cast<std::size_t>((y - rect_.y0) % ring_rows_);
}

std::int16_t* StereoMatcher::result_row(int y) {
  return result_.data() + static_cast<std::size_t>(y) * result_stride_ + kLanes;
}

int StereoMatcher::right_columns() const {
  const int wanted = rect_.x1 - rect_.x0 + options_.disparity_count - 1;
  return std::clamp(rect_.x1 - options_.disparity_min, 0, wanted);
}

void StereoMatcher::take_in(const Pair& pair, int y) {
  const int width = rect_.x1 - rect_.x0;
  copy_grays(pair.left, y, rect_.x0, 1, -kCensusReach, width + kCensusReach,
             gray_row(left_gray_, y));
  copy_grays(pair.right, y, rect_.x1 - options_.disparity_min - 1, -1, -kCensusReach,
             right_columns() + kCensusReach, gray_row(right_gray_, y));
}

// Hamming distances of row y, for which the rows up to y + 2 are taken in.
void StereoMatcher::compute_raw(const Pair& pair, int y) {
  while (next_taken_ <= std::min(y + 2, height_ - 1)) take_in(pair, next_taken_++);
  stereo_kernels::CensusRow left{};
  stereo_kernels::CensusRow right{};
  for (int k = 0; k < 5; ++k) {
    const int row = std::clamp(y + k - 2, 0, height_ - 1);
    left.rows[k] = gray_row(left_gray_, row);
    right.rows[k] = gray_row(right_gray_, row);
  }
  const int width = rect_.x1 - rect_.x0;
  left.width = width;
  right.width = right_columns();
  left.shape = right.shape = shape_;
  right.mirrored = true;
  left.planes = left_planes_.data();
  right.planes = right_planes_.data();
  kernels_->census_row(left);
  kernels_->census_row(right);
  // Beyond the right image's edge: half of the bits set, as far from one code as from another.
  constexpr std::uint8_t kNowhere = 5;
  const int planes = plane_count(shape_);
  const int end = width + options_.disparity_count;
  for (int plane = 0; plane < planes; ++plane) {
    std::uint8_t* row = right.planes + plane * stereo_kernels::kPlaneStride;
    std::fill(row + right.width, row + std::max(end, right.width), kNowhere);
  }
  kernels_->hamming_row(
      {left.planes, right.planes + width - 1, planes, width, options_.disparity_count, raw_row(y)});
}

void StereoMatcher::compute_cost(const Pair& pair, int y, std::uint8_t* cost) {
  while (next_raw_ <= std::min(y + 1, height_ - 1)) compute_raw(pair, next_raw_++);
  kernels_->box_row({raw_row(std::max(y - 1, 0)), raw_row(y), raw_row(std::min(y + 1, height_ - 1)),
                     rect_.x1 - rect_.x0, options_.disparity_count,
                     options_.mode == MatcherMode::kAccurate, cost});
}

// The penalty of a jump is less where the image has an edge (Hirschmueller 2008, section 2.2).
void StereoMatcher::compute_penalties(int y, std::uint8_t* north) {
  std::uint8_t* guide = guide_.data() + static_cast<std::size_t>(y % 2) * row_stride_;
  const std::uint8_t* upper = guide_.data() + static_cast<std::size_t>((y + 1) % 2) * row_stride_;
  kernels_->penalty_row({gray_row(left_gray_, y), guide_gain_, y == rect_.y0 ? guide : upper, guide,
                         rect_.x1 - rect_.x0, penalty_2_, penalty_2_least_, penalty_slope_,
                         penalty_west_.data(), north});
}

void StereoMatcher::measure_texture(int y) {
  constexpr int kRises = 3 * 2 * kCensusReach;
  const auto gray = [&](int k) { return gray_row(left_gray_, std::clamp(y + k, 0, height_ - 1)); };
  kernels_->texture_row({{gray(-2), gray(0), gray(2)},
                         rect_.x1 - rect_.x0,
                         kRises * options_.texture_min,
                         rises_.data() + kLanes,
                         flat_.data() + static_cast<std::size_t>(y) * row_stride_});
}

// Costs and penalties of row y, and the sum of the paths that come from the west and the north.
stereo_kernels::PathRow StereoMatcher::sum_forward(const Pair& pair, int y) {
  std::uint8_t* cost = cost_.data() + ring_slot(y) * cost_stride_;
  std::uint8_t* north = penalty_north_.data() + ring_slot(y) * row_stride_;
  compute_cost(pair, y, cost);
  compute_penalties(y, north);
  measure_texture(y);
  const stereo_kernels::PathRow row{
      cost,          penalty_west_.data(), north,
      penalty_1_,    rect_.x1 - rect_.x0,  options_.disparity_count,
      north_.data(), north_min_.data(),    sum_.data() + ring_slot(y) * cost_stride_};
  kernels_->forward_row(row);
  return row;
}

// The path from the south into row y: its penalties are those of the row below towards this one.
stereo_kernels::PathRow StereoMatcher::upward_path(int y) {
  const int below = std::min(y + 1, rect_.y1 - 1);
  return {cost_.data() + ring_slot(y) * cost_stride_,
          nullptr,
          penalty_north_.data() + ring_slot(below) * row_stride_,
          penalty_1_,
          rect_.x1 - rect_.x0,
          options_.disparity_count,
          south_.data(),
          south_min_.data(),
          sum_.data() + ring_slot(y) * cost_stride_};
}

stereo_kernels::WinnerRow StereoMatcher::winner_row() {
  return {rect_.x0 - options_.disparity_min,
          unique_limit_,
          winner_.data(),
          winner_cost_.data(),
          cost_below_.data(),
          cost_above_.data(),
          right_winner_.data() + stereo_kernels::kDisparitiesMax};
}

// From winners to disparities: checked from the right image, with the sub-pixel part.
void StereoMatcher::finish_row(int y) {
  const int width = rect_.x1 - rect_.x0;
  const std::uint8_t* right = right_winner_.data() + stereo_kernels::kDisparitiesMax;
  const std::uint8_t* winner = winner_.data();
  std::uint8_t* seen = seen_from_right_.data();
  for (int x = 0; x < width; ++x) seen[x] = right[x - winner[x]];
  const bool checks = options_.left_right_difference >= 0;
  kernels_->disparity_row({winner, winner_cost_.data(), cost_below_.data(), cost_above_.data(),
                           seen, flat_.data() + static_cast<std::size_t>(y) * row_stride_, width,
                           checks ? options_.left_right_difference : kDisparitiesMax,
                           options_.disparity_min, result_row(y),
                           sigma_.data() + static_cast<std::size_t>(y) * row_stride_});
}

void StereoMatcher::smooth_and_write(const PixelRect& inner, ImageView<std::int16_t> disparity,
                                     ImageView<std::uint8_t> sigma) {
  const int width = rect_.x1 - rect_.x0, height = rect_.y1 - rect_.y0;
  for (int y = rect_.y0; y < rect_.y1; ++y) {
    std::int16_t* row = result_row(y);
    row[-1] = row[0];
    row[width] = row[width - 1];
  }
  std::int16_t* smooth = smooth_.data();
  for (int y = rect_.y0; y < rect_.y1; ++y, smooth += width) {
    if (options_.median)
      kernels_->median_row({{result_row(std::max(y - 1, rect_.y0)), result_row(y),
                             result_row(std::min(y + 1, rect_.y1 - 1))},
                            width,
                            smooth});
    else
      std::copy_n(result_row(y), width, smooth);
  }
  const ImageView<std::int16_t> view{smooth_.data(), width, height};
  speckle_.apply(view, options_.speckle_pixels, options_.speckle_difference * kDisparityScale,
                 {rect_.x0 > 0, rect_.y0 > 0, rect_.x1 < width_, rect_.y1 < height_});
  for (int y = inner.y0; y < inner.y1; ++y)
    std::copy_n(view.pixels + view.index(inner.x0 - rect_.x0, y - rect_.y0), inner.x1 - inner.x0,
                disparity.pixels + disparity.index(inner.x0, y));
  for (int y = inner.y0; sigma.pixels != nullptr && y < inner.y1; ++y)
    std::copy_n(sigma_.data() + static_cast<std::size_t>(y) * row_stride_ + (inner.x0 - rect_.x0),
                inner.x1 - inner.x0, sigma.pixels + sigma.index(inner.x0, y));
}

}  // namespace wagonsight
