#include "stereo/alignment.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "base/check.h"

namespace wagonsight {
namespace {

constexpr int kHalfPatch = 5;
constexpr int kPatchPixels = (2 * kHalfPatch + 1) * (2 * kHalfPatch + 1);
constexpr int kRowsMax = 8;
constexpr int kBorder = kHalfPatch + 2;  // room for the patch and its gradients

int border_rows(const AlignmentOptions& options) {
  return kBorder + options.rows_searched;
}

float gray(const GrayImage& image, int x, int y) {
  const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                         static_cast<std::size_t>(x);
  return image.format == PixelFormat::kGray8
             ? static_cast<float>(static_cast<const std::uint8_t*>(image.pixels)[at]) * 16.0F
             : static_cast<float>(static_cast<const std::uint16_t*>(image.pixels)[at]);
}

// A patch without its mean and of length one, so that the product of two is their correlation.
struct Patch {
  float values[kPatchPixels];
};
std::optional<Patch> patch_at(const GrayImage& image, int x, int y) {
  Patch patch;
  float sum = 0;
  int count = 0;
  for (int dy = -kHalfPatch; dy <= kHalfPatch; ++dy)
    for (int dx = -kHalfPatch; dx <= kHalfPatch; ++dx)
      sum += patch.values[count++] = gray(image, x + dx, y + dy);
  const float mean = sum / kPatchPixels;
  float squares = 0;
  for (float& value : patch.values) {
    value -= mean;
    squares += value * value;
  }
  if (squares < kPatchPixels) return std::nullopt;  // flat: less than one gray level of 4095
  const float scale = 1.0F / std::sqrt(squares);
  for (float& value : patch.values) value *= scale;
  return patch;
}

// The correlation of a patch with the pixels around (x, y), in one pass: the first patch has no
// mean, so the other's does not count. Sums of squares are whole numbers, so nothing cancels.
template <class Gray>
float correlation_at(const Patch& patch, const GrayImage& image, int x, int y, unsigned scale) {
  std::uint64_t squares = 0;
  std::uint32_t sum = 0;
  float product[2 * kHalfPatch + 1] = {};
  const float* wanted = patch.values;
  for (int dy = -kHalfPatch; dy <= kHalfPatch; ++dy) {
    const Gray* row = static_cast<const Gray*>(image.pixels) +
                      static_cast<std::size_t>(y + dy) * static_cast<std::size_t>(image.width) +
                      static_cast<std::size_t>(x - kHalfPatch);
    for (int k = 0; k <= 2 * kHalfPatch; ++k) {
      const std::uint32_t value = row[k] * scale;
      sum += value;
      squares += std::uint64_t{value} * value;
      product[k] += wanted[k] * static_cast<float>(static_cast<int>(value));
    }
    wanted += 2 * kHalfPatch + 1;
  }
  const double mean = static_cast<double>(sum) / kPatchPixels;
  const double rest = static_cast<double>(squares) - mean * static_cast<double>(sum);
  if (rest < kPatchPixels) return -1.0F;  // flat: less than one gray level of 4095
  float total = 0;
  for (const float part : product) total += part;
  return total / static_cast<float>(std::sqrt(rest));
}
float correlation(const Patch& patch, const GrayImage& image, int x, int y) {
  return image.format == PixelFormat::kGray8 ? correlation_at<std::uint8_t>(patch, image, x, y, 16)
                                             : correlation_at<std::uint16_t>(patch, image, x, y, 1);
}

// The smaller eigenvalue of the structure tensor (Shi and Tomasi 1994).
double corner_strength(const GrayImage& image, int x, int y) {
  double xx = 0, xy = 0, yy = 0;
  for (int dy = -2; dy <= 2; ++dy)
    for (int dx = -2; dx <= 2; ++dx) {
      const double gx = gray(image, x + dx + 1, y + dy) - gray(image, x + dx - 1, y + dy);
      const double gy = gray(image, x + dx, y + dy + 1) - gray(image, x + dx, y + dy - 1);
      xx += gx * gx;
      xy += gx * gy;
      yy += gy * gy;
    }
  return (xx + yy) / 2 - std::sqrt((xx - yy) * (xx - yy) / 4 + xy * xy);
}

float median(BoundedVector<float>& values) {
  float* middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

AlignmentCheck::AlignmentCheck(int width, int height, const AlignmentOptions& options)
    : options_(options), width_(width), height_(height) {
  WS_CHECK(options.cell_px >= 8 && options.rows_searched >= 1 && options.rows_searched <= kRowsMax,
           "cell %d, rows %d", options.cell_px, options.rows_searched);
  const auto cells = [&](int size) { return static_cast<std::size_t>(size / options.cell_px + 1); };
  const std::size_t count = cells(width) * cells(height);
  bands_ = std::max(1, (height - 2 * border_rows(options) + options.cell_px - 1) / options.cell_px);
  corners_ = BoundedVector<Corner>(count);
  offsets_ = BoundedVector<float>(count);
  deviations_ = BoundedVector<float>(count);
}

int AlignmentCheck::first_row(int band) const {
  return border_rows(options_) + band * options_.cell_px;
}

int AlignmentCheck::end_row(int band) const {
  return std::min(first_row(band) + options_.cell_px, height_ - border_rows(options_));
}

PixelRect AlignmentCheck::rows_of(int band) const {
  const int around = border_rows(options_);
  return {0, std::max(first_row(band) - around, 0), width_,
          std::min(std::max(end_row(band), 0) + around, height_)};
}

void AlignmentCheck::measure_band(const GrayImage& left, const GrayImage& right, int band) {
  WS_CHECK(left.width == width_ && left.height == height_ && band >= 0 && band < bands_,
           "%d x %d, made for %d x %d, band %d", left.width, left.height, width_, height_, band);
  find_corners(left, band);
  for (const Corner& corner : corners_) find_offset(left, right, corner);
}

RowAlignment AlignmentCheck::measure(const GrayImage& left, const GrayImage& right) {
  begin();
  for (int band = 0; band < bands_; ++band) measure_band(left, right, band);
  return result();
}

RowAlignment AlignmentCheck::result() {
  RowAlignment result;
  result.features = static_cast<int>(offsets_.size());
  if (offsets_.empty()) return result;
  const float middle = median(offsets_);
  deviations_.clear();
  for (const float offset : offsets_)
    if (!deviations_.try_push_back(std::abs(offset - middle))) break;
  result.median_offset_px = middle;
  result.spread_px = median(deviations_);
  // A scatter of a pixel is that of wrong matches, not of corners.
  result.reliable = result.features >= options_.features_min && result.spread_px < 1.0;
  return result;
}

void AlignmentCheck::find_corners(const GrayImage& left, int band) {
  corners_.clear();
  for (int x0 = kBorder + options_.disparity_min; x0 < width_ - kBorder; x0 += options_.cell_px) {
    // Two gray levels of 4095 in either direction over the window: above any imager's noise.
    double strength = 5000;
    const Corner best =
        best_corner(left, x0, first_row(band), std::min(x0 + options_.cell_px, width_ - kBorder),
                    end_row(band), strength);
    if (best.x >= 0 && !corners_.try_push_back(best)) return;
  }
}

AlignmentCheck::Corner AlignmentCheck::best_corner(const GrayImage& left, int x0, int y0, int x1,
                                                   int y1, double& strength) const {
  Corner best{-1, -1};
  for (int y = y0; y < y1; y += 2)
    for (int x = x0; x < x1; x += 2)
      if (const double s = corner_strength(left, x, y); s > strength) {
        strength = s;
        best = {x, y};
      }
  return best;
}

void AlignmentCheck::find_offset(const GrayImage& left, const GrayImage& right,
                                 const Corner& corner) {
  const auto wanted = patch_at(left, corner.x, corner.y);
  if (!wanted) return;
  float by_row[2 * kRowsMax + 1];
  const int rows = options_.rows_searched;
  std::fill_n(by_row, 2 * rows + 1, -1.0F);
  for (int dy = -rows; dy <= rows; ++dy)
    for (int d = options_.disparity_min; d < options_.disparity_min + options_.disparity_count;
         ++d) {
      const int x = corner.x - d;
      if (x < kHalfPatch) break;
      by_row[dy + rows] =
          std::max(by_row[dy + rows], correlation(*wanted, right, x, corner.y + dy));
    }
  const int best = static_cast<int>(std::max_element(by_row, by_row + 2 * rows + 1) - by_row);
  // At the search's end the best may lie beyond it.
  if (by_row[best] < options_.correlation_min || best == 0 || best == 2 * rows) return;
  const float below = by_row[best - 1], peak = by_row[best], above = by_row[best + 1];
  const float curvature = below - 2 * peak + above;
  const float fine = curvature < 0 ? 0.5F * (below - above) / curvature : 0.0F;
  if (!offsets_.try_push_back(static_cast<float>(best - rows) + fine)) return;
}

}  // namespace wagonsight
