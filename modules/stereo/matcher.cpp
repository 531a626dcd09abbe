#include "stereo/matcher.h"

#include <algorithm>

#include "base/capacities.h"
#include "base/check.h"

namespace wagonsight {

using stereo_kernels::CensusShape;
using stereo_kernels::kDisparitiesMax;
using stereo_kernels::kLanes;

namespace {

constexpr int kDisparityMinMax = 255;

constexpr std::size_t rounded_up(int value, int step) {
  return static_cast<std::size_t>((value + step - 1) / step * step);
}

Result<void> check(int width, int height, const MatcherOptions& options) {
  const auto complaint = [](const std::string& what) {
    return fail("the stereo matcher cannot be made: " + what);
  };
  if (width < 1 || height < 1 ||
      static_cast<std::size_t>(width) * static_cast<std::size_t>(height) > kImagePixelsMax)
    return complaint("its images would have " + std::to_string(width) + " x " +
                     std::to_string(height) + " pixels; give 1 to 1920 x 1080");
  if (width > stereo_kernels::kWidthMax)
    return complaint("its images would be " + std::to_string(width) +
                     " pixels wide; give at most " + std::to_string(stereo_kernels::kWidthMax));
  if (options.disparity_count < kLanes || options.disparity_count > kDisparitiesMax ||
      options.disparity_count % kLanes != 0)
    return complaint("disparity_count is " + std::to_string(options.disparity_count) +
                     "; give a multiple of 32 from 32 to 256");
  if (options.disparity_min < 0 || options.disparity_min > kDisparityMinMax)
    return complaint("disparity_min is " + std::to_string(options.disparity_min) +
                     "; give 0 to 255 pixels");
  if (options.uniqueness_percent < 0 || options.uniqueness_percent > 99)
    return complaint("uniqueness_percent is " + std::to_string(options.uniqueness_percent) +
                     "; give 0 to 99");
  if (options.texture_min < 0 || options.texture_min > 2047)
    return complaint("texture_min is " + std::to_string(options.texture_min) + "; give 0 to 2047");
  return {};
}

}  // namespace

Result<StereoMatcher> StereoMatcher::create(int width, int height, const MatcherOptions& options,
                                            const stereo_kernels::Kernels& kernels) {
  if (const auto checked = check(width, height, options); !checked)
    return fail(checked.error().message);
  return StereoMatcher(width, height, options, kernels);
}

StereoMatcher::StereoMatcher(int width, int height, const MatcherOptions& options,
                             const stereo_kernels::Kernels& kernels)
    : kernels_(&kernels),
      options_(options),
      width_(width),
      height_(height),
      shape_(options.mode == MatcherMode::kFast ? CensusShape::kNarrow : CensusShape::kWide),
      speckle_(width, height) {
  choose_penalties();
  allocate_rows();
}

// Tuned on the Middlebury cone pair, with and without a change of gain and gamma between the
// imagers, on the aloe pair at two scales and on simulated pairs by day and in a tunnel, by bad
// pixels at equal density: values that are good for all of them. A cost is at most
// 108 in the fast mode and 72 in the accurate one, so that three and four of
// them rarely saturate a byte.
void StereoMatcher::choose_penalties() {
  const bool fast = options_.mode == MatcherMode::kFast;
  penalty_1_ = fast ? 26 : 20;
  penalty_2_ = fast ? 90 : 70;
  penalty_2_least_ = fast ? 35 : 25;
  penalty_slope_ = fast ? 5 : 4;
  for (int cost = 0; cost < 256; ++cost) {
    const int limit = cost * 100 / (100 - options_.uniqueness_percent) + 1;
    unique_limit_[cost] =
        static_cast<std::uint8_t>(options_.uniqueness_percent == 0 ? 0 : std::min(limit, 255));
  }
}

void StereoMatcher::allocate_rows() {
  const int disparities = options_.disparity_count;
  const auto rows_of = [](int count, std::size_t stride) {
    return static_cast<std::size_t>(count) * stride;
  };
  gray_stride_ = rounded_up(width_ + disparities, kLanes) + 2 * kLanes;
  row_stride_ = rounded_up(width_, kLanes);
  cost_stride_ = rows_of(width_, static_cast<std::size_t>(disparities));
  result_stride_ = rounded_up(width_, kLanes) + 2 * kLanes;
  ring_rows_ = options_.mode == MatcherMode::kFast ? 1 : kStripRows + kLookAheadRows;

  left_gray_ = AlignedArray<std::uint16_t>(rows_of(kGrayRows, gray_stride_));
  right_gray_ = AlignedArray<std::uint16_t>(rows_of(kGrayRows, gray_stride_));
  guide_ = AlignedArray<std::uint8_t>(rows_of(2, row_stride_));
  for (auto* planes : {&left_planes_, &right_planes_})
    *planes = AlignedArray<std::uint8_t>(
        rows_of(stereo_kernels::kPlanesMax, stereo_kernels::kPlaneStride));
  raw_ = AlignedArray<std::uint8_t>(rows_of(kRawRows, cost_stride_));
  cost_ = AlignedArray<std::uint8_t>(rows_of(ring_rows_, cost_stride_));
  sum_ = AlignedArray<std::uint8_t>(rows_of(ring_rows_, cost_stride_));
  north_ = AlignedArray<std::uint8_t>(cost_stride_);
  north_min_ = AlignedArray<std::uint8_t>(row_stride_);
  penalty_west_ = AlignedArray<std::uint8_t>(row_stride_ + 1);
  penalty_north_ = AlignedArray<std::uint8_t>(rows_of(ring_rows_, row_stride_));
  if (options_.mode == MatcherMode::kAccurate) {
    south_ = AlignedArray<std::uint8_t>(cost_stride_);
    south_min_ = AlignedArray<std::uint8_t>(row_stride_);
  }
  for (auto* row : {&winner_, &winner_cost_, &cost_below_, &cost_above_, &seen_from_right_})
    *row = AlignedArray<std::uint8_t>(row_stride_);
  right_winner_ = AlignedArray<std::uint8_t>(row_stride_ + kDisparitiesMax);
  rises_ = AlignedArray<std::uint16_t>(row_stride_ + 2 * kLanes);
  flat_ = AlignedArray<std::uint8_t>(rows_of(height_, row_stride_));
  sigma_ = AlignedArray<std::uint8_t>(flat_.size());
  result_ = AlignedArray<std::int16_t>(rows_of(height_, result_stride_));
  smooth_ = AlignedArray<std::int16_t>(rows_of(height_, row_stride_) + result_stride_);
}

std::size_t StereoMatcher::workspace_bytes() const {
  return 2 * (left_gray_.size() + right_gray_.size() + result_.size() + smooth_.size()) +
         guide_.size() + left_planes_.size() + right_planes_.size() + raw_.size() + cost_.size() +
         sum_.size() + north_.size() + north_min_.size() + south_.size() + south_min_.size() +
         penalty_west_.size() + penalty_north_.size() + 5 * winner_.size() + right_winner_.size() +
         flat_.size() + sigma_.size() + 2 * rises_.size() + speckle_.workspace_bytes();
}

void StereoMatcher::check_images(const Pair& pair, const ImageView<std::int16_t>& disparity) const {
  for (const GrayImage* image : {&pair.left, &pair.right}) {
    WS_CHECK(image->width == width_ && image->height == height_, "%d x %d, made for %d x %d",
             image->width, image->height, width_, height_);
    WS_CHECK(image->format == PixelFormat::kGray8 || image->format == PixelFormat::kGray16,
             "pixel format %d", static_cast<int>(image->format));
  }
  WS_CHECK(disparity.width == width_ && disparity.height == height_, "%d x %d, made for %d x %d",
           disparity.width, disparity.height, width_, height_);
}

void StereoMatcher::match(const GrayImage& left, const GrayImage& right,
                          ImageView<std::int16_t> disparity) {
  const PixelRect whole{0, 0, width_, height_};
  match_regions(left, right, {&whole, 1}, disparity);
}

void StereoMatcher::match_regions(const GrayImage& left, const GrayImage& right,
                                  std::span<const PixelRect> regions,
                                  ImageView<std::int16_t> disparity, const GrayImage& bright_as,
                                  ImageView<std::uint8_t> sigma) {
  const Pair pair{left, right};
  check_images(pair, disparity);
  if (regions.empty()) return;
  WS_CHECK(sigma.pixels == nullptr || (sigma.width == width_ && sigma.height == height_),
           "%d x %d, made for %d x %d", sigma.width, sigma.height, width_, height_);
  WS_CHECK(bright_as.width == width_ && bright_as.height == height_, "%d x %d", bright_as.width,
           bright_as.height);
  measure_brightness(bright_as);
  for (const PixelRect& region : regions) {
    const PixelRect inner{std::max(region.x0, 0), std::max(region.y0, 0),
                          std::min(region.x1, width_), std::min(region.y1, height_)};
    if (!inner.empty()) match_rect(pair, inner, disparity, sigma);
  }
}

// The paths' run-up, the window and the census.
PixelRect StereoMatcher::reach_left(const PixelRect& region) const {
  const int around = context_px() + 1 + stereo_kernels::kCensusReach;
  return {std::max(region.x0 - around, 0), std::max(region.y0 - around, 0),
          std::min(region.x1 + around, width_), std::min(region.y1 + around, height_)};
}

PixelRect StereoMatcher::reach_right(const PixelRect& region) const {
  PixelRect rect = reach_left(region);
  rect.x0 = std::max(rect.x0 - options_.disparity_min - options_.disparity_count, 0);
  // Where all that is searched lies beyond the edge, its column is read.
  rect.x1 =
      std::max(rect.x1 - options_.disparity_min, std::min(stereo_kernels::kCensusReach, width_));
  return rect;
}

void StereoMatcher::match_rect(const Pair& pair, const PixelRect& inner,
                               ImageView<std::int16_t> disparity, ImageView<std::uint8_t> sigma) {
  begin_rect({std::max(inner.x0 - context_px(), 0), std::max(inner.y0 - context_px(), 0),
              std::min(inner.x1 + context_px(), width_),
              std::min(inner.y1 + context_px(), height_)});
  options_.mode == MatcherMode::kFast ? run_fast(pair) : run_accurate(pair);
  smooth_and_write(inner, disparity, sigma);
}

void StereoMatcher::begin_rect(const PixelRect& rect) {
  rect_ = rect;
  next_raw_ = std::max(rect.y0 - 1, 0);
  next_taken_ = std::max(next_raw_ - 2, 0);
  std::fill_n(north_.data(), north_.size(), std::uint8_t{0});
  std::fill_n(north_min_.data(), north_min_.size(), std::uint8_t{0});
}

void StereoMatcher::run_fast(const Pair& pair) {
  for (int y = rect_.y0; y < rect_.y1; ++y) {
    const auto row = sum_forward(pair, y);
    kernels_->backward_winners(row, winner_row());
    finish_row(y);
  }
}

// The path from the south needs the rows below first: strips of rows are swept upwards, beginning
// some rows further down, where the path has forgotten that it began.
void StereoMatcher::run_accurate(const Pair& pair) {
  int next = rect_.y0;
  for (int y0 = rect_.y0; y0 < rect_.y1; y0 += kStripRows) {
    const int y1 = std::min(y0 + kStripRows, rect_.y1);
    const int below = std::min(y1 + kLookAheadRows, rect_.y1);
    for (; next < below; ++next) kernels_->backward_row(sum_forward(pair, next));
    std::fill_n(south_.data(), south_.size(), std::uint8_t{0});
    std::fill_n(south_min_.data(), south_min_.size(), std::uint8_t{0});
    for (int y = below - 1; y >= y0; --y) {
      const auto row = upward_path(y);
      if (y >= y1) {
        kernels_->upward_row(row);
        continue;
      }
      kernels_->upward_winners(row, winner_row());
      finish_row(y);
    }
  }
}

}  // namespace wagonsight
