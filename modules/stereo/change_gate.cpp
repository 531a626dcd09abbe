#include "stereo/change_gate.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace wagonsight {
namespace {

constexpr int kTile = 16;
constexpr int kTileSamples = kTile / 2;  // in each direction
// Four-fold of the noise's own variance: with 64 samples a tile the estimate scatters by a fifth.
constexpr double kVarianceFactor = 4.0;
// Of a tile's texture that may change without a reason in the scene: vignetting moves with the
// aperture's gain, and a mount trembles by a fraction of a pixel.
constexpr double kTextureShare = 0.05;
constexpr double kMeanShare = 0.2;
constexpr std::size_t kRegionsMax = 64;

std::uint16_t sample_of(const GrayImage& image, int x, int y) {
  // A last odd column or row counts twice.
  const int x1 = std::min(x + 1, image.width - 1), y1 = std::min(y + 1, image.height - 1);
  const auto at = [&](int u, int v) -> unsigned {
    const std::size_t index = static_cast<std::size_t>(v) * static_cast<std::size_t>(image.width) +
                              static_cast<std::size_t>(u);
    if (image.format == PixelFormat::kGray8)
      return static_cast<const std::uint8_t*>(image.pixels)[index] * 16U;
    return static_cast<const std::uint16_t*>(image.pixels)[index];
  };
  const unsigned sum = at(x, y) + at(x1, y) + at(x, y1) + at(x1, y1);
  return static_cast<std::uint16_t>(std::min((sum + 2) / 4, 16383U));
}

bool touch(const PixelRect& a, const PixelRect& b) {
  return a.x0 <= b.x1 && b.x0 <= a.x1 && a.y0 <= b.y1 && b.y0 <= a.y1;
}

std::int64_t area(const PixelRect& r) {
  return static_cast<std::int64_t>(r.x1 - r.x0) * (r.y1 - r.y0);
}

}  // namespace

ChangeGate::ChangeGate(int width, int height, const ChangeGateOptions& options)
    : options_(options),
      width_(width),
      height_(height),
      columns_((width + kTile - 1) / kTile),
      rows_((height + kTile - 1) / kTile),
      sample_columns_(columns_ * kTileSamples),
      sample_rows_(rows_ * kTileSamples) {
  WS_CHECK(width > 0 && height > 0, "%d x %d", width, height);
  const std::size_t tile_count =
      static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  samples_ = AlignedArray<std::uint16_t>(tile_count * kTileSamples * kTileSamples);
  reference_ = AlignedArray<std::uint16_t>(samples_.size());
  marked_ = AlignedArray<std::uint8_t>(tile_count);
  tiles_ = BoundedVector<Tile>(tile_count);
  ratios_ = BoundedVector<double>(tile_count);
  pending_ = BoundedVector<std::uint32_t>(tile_count);
  regions_ = BoundedVector<PixelRect>(kRegionsMax);
}

std::span<const PixelRect> ChangeGate::regions(const GrayImage& left, bool whole,
                                               std::span<const PixelRect> feedback,
                                               RectifyTable table) {
  WS_CHECK(left.width == width_ && left.height == height_, "%d x %d, made for %d x %d", left.width,
           left.height, width_, height_);
  if (table.empty())
    take_samples(left);
  else if (left.format == PixelFormat::kGray8)
    take_samples_by_table<std::uint8_t>(left, table, 16);
  else
    take_samples_by_table<std::uint16_t>(left, table, 1);
  std::fill_n(marked_.data(), marked_.size(), std::uint8_t{0});
  if (has_reference_) mark_changes();
  regions_.clear();
  const PixelRect all{0, 0, width_, height_};
  if (whole || !has_reference_) {
    (void)regions_.try_push_back(all);  // there is room: it was cleared
  } else {
    for (const PixelRect& rect : feedback) mark(rect);
    collect_regions();
    std::int64_t wanted = 0;
    for (const PixelRect& region : regions_) wanted += area(region);
    if (static_cast<double>(wanted) > options_.whole_share * static_cast<double>(area(all))) {
      regions_.clear();
      (void)regions_.try_push_back(all);
    }
  }
  for (const PixelRect& region : regions_) keep_reference(region);
  has_reference_ = true;
  return regions_.span();
}

void ChangeGate::take_samples(const GrayImage& image) {
  std::uint16_t* out = samples_.data();
  const int full_columns = width_ / 2;
  for (int row = 0; row < sample_rows_; ++row) {
    const int y = std::min(2 * row, height_ - 1);
    int column = 0;
    // The quick way for what has all of its four pixels.
    if (image.format == PixelFormat::kGray16 && y + 1 < height_) {
      const auto* upper = static_cast<const std::uint16_t*>(image.pixels) +
                          static_cast<std::size_t>(y) * static_cast<std::size_t>(width_);
      const auto* lower = upper + width_;
      for (; column < full_columns; ++column) {
        const unsigned sum = static_cast<unsigned>(upper[2 * column]) + upper[2 * column + 1] +
                             lower[2 * column] + lower[2 * column + 1];
        const unsigned mean = (sum + 2) / 4;
        out[column] = static_cast<std::uint16_t>(mean < 16383U ? mean : 16383U);
      }
    }
    for (; column < sample_columns_; ++column)
      out[column] = sample_of(image, std::min(2 * column, width_ - 1), y);
    out += sample_columns_;
  }
}

// The four pixels that rectification would blend, without its weights: these do not change, and all
// of a rectified image would cost more than finding out that little of it is needed.
template <class Gray>
void ChangeGate::take_samples_by_table(const GrayImage& image, RectifyTable table, unsigned scale) {
  WS_CHECK(table.size() == static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_),
           "%zu entries for %d x %d", table.size(), width_, height_);
  const auto* pixels = static_cast<const Gray*>(image.pixels);
  const auto below = static_cast<std::size_t>(image.width);
  std::uint16_t* out = samples_.data();
  for (int row = 0; row < sample_rows_; ++row, out += sample_columns_) {
    const RectifyEntry* entries =
        table.data() +
        static_cast<std::size_t>(std::min(2 * row, height_ - 1)) * static_cast<std::size_t>(width_);
    for (int column = 0; column < sample_columns_; ++column) {
      const RectifyEntry entry = entries[std::min(2 * column, width_ - 1)];
      const Gray* at = pixels + ((entry & ~kOutsideSource) >> 10);
      const unsigned sum =
          (static_cast<unsigned>(at[0]) + at[1] + at[below] + at[below + 1]) * scale;
      const unsigned mean = std::min((sum + 2) / 4, 16383U);
      out[column] = entry == kOutsideSource ? std::uint16_t{0} : static_cast<std::uint16_t>(mean);
    }
  }
}

ChangeGate::Tile ChangeGate::measure(int column, int row) const {
  std::uint64_t c = 0, r = 0, cc = 0, rr = 0, cr = 0;
  const std::size_t first =
      static_cast<std::size_t>(row * kTileSamples) * static_cast<std::size_t>(sample_columns_) +
      static_cast<std::size_t>(column * kTileSamples);
  for (int y = 0; y < kTileSamples; ++y) {
    const std::size_t at =
        first + static_cast<std::size_t>(y) * static_cast<std::size_t>(sample_columns_);
    std::uint32_t row_c = 0, row_r = 0, row_cc = 0, row_rr = 0, row_cr = 0;  // 8 x 28 bits fit
    for (std::size_t x = 0; x < kTileSamples; ++x) {
      const std::uint32_t now = samples_[at + x], then = reference_[at + x];
      row_c += now;
      row_r += then;
      row_cc += now * now;
      row_rr += then * then;
      row_cr += now * then;
    }
    c += row_c, r += row_r, cc += row_cc, rr += row_rr, cr += row_cr;
  }
  constexpr double kCount = kTileSamples * kTileSamples;
  const double mean = static_cast<double>(c) / kCount, mean_r = static_cast<double>(r) / kCount;
  return {mean, mean_r, static_cast<double>(cc) / kCount - mean * mean,
          static_cast<double>(rr) / kCount - mean_r * mean_r,
          static_cast<double>(cr) / kCount - mean * mean_r};
}

// The brightness of the whole image against the reference: the median over the tiles, so that
// people in up to half of the image do not count.
double ChangeGate::gain_of_all() {
  ratios_.clear();
  for (const Tile& tile : tiles_)
    if (tile.mean_reference > 16 && !ratios_.try_push_back(tile.mean / tile.mean_reference)) break;
  if (ratios_.empty()) return 1.0;
  double* middle = ratios_.begin() + ratios_.size() / 2;
  std::nth_element(ratios_.begin(), middle, ratios_.end());
  return std::clamp(*middle, 1.0 / 64, 64.0);
}

double ChangeGate::rest_of(const Tile& tile, double gain) {
  return tile.variance - 2 * gain * tile.covariance + gain * gain * tile.variance_reference;
}

// The variance of a difference that is nobody's: the median over the tiles, not less than the
// imager's own and not more than a sixteenfold of it, which is a crowd.
double ChangeGate::noise_of_all(double gain) {
  constexpr double kMost = 16;
  const double noise = options_.noise_levels / 2;  // a sample is the mean of four pixels
  const double own = (1 + gain * gain) * noise * noise;
  ratios_.clear();
  for (const Tile& tile : tiles_)
    if (!ratios_.try_push_back(rest_of(tile, gain))) break;
  double* middle = ratios_.begin() + ratios_.size() / 2;
  std::nth_element(ratios_.begin(), middle, ratios_.end());
  return std::clamp(*middle, own, kMost * own);
}

bool ChangeGate::differs(const Tile& tile, double gain, double noise) {
  const double texture = gain * gain * tile.variance_reference;
  if (rest_of(tile, gain) > kVarianceFactor * noise + kTextureShare * texture) return true;
  const double predicted = gain * tile.mean_reference;
  return std::abs(tile.mean - predicted) > kMeanShare * predicted + 4 * std::sqrt(noise);
}

void ChangeGate::mark_changes() {
  tiles_.clear();
  for (int row = 0; row < rows_; ++row)
    for (int column = 0; column < columns_; ++column)
      (void)tiles_.try_push_back(measure(column, row));  // has room for every tile
  const double gain = gain_of_all(), noise = noise_of_all(gain);
  std::size_t changed = 0;
  for (int row = 0; row < rows_; ++row)
    for (int column = 0; column < columns_; ++column) {
      if (!differs(tiles_[tile_index(column, row)], gain, noise)) continue;
      ++changed;
      mark({column * kTile, row * kTile, (column + 1) * kTile, (row + 1) * kTile});
    }
  changed_share_ = static_cast<double>(changed) / static_cast<double>(tiles_.size());
}

void ChangeGate::mark(const PixelRect& rect) {
  if (rect.empty()) return;
  const int margin = options_.margin_px;
  const int first_column = std::max(rect.x0 - margin, 0) / kTile;
  const int first_row = std::max(rect.y0 - margin, 0) / kTile;
  const int last_column = std::min((rect.x1 - 1 + margin) / kTile, columns_ - 1);
  const int last_row = std::min((rect.y1 - 1 + margin) / kTile, rows_ - 1);
  for (int row = first_row; row <= last_row; ++row)
    for (int column = first_column; column <= last_column; ++column)
      marked_[tile_index(column, row)] = 1;
}

// Boxes around the connected groups of marked tiles; boxes that touch become one.
void ChangeGate::collect_regions() {
  for (int row = 0; row < rows_; ++row)
    for (int column = 0; column < columns_; ++column) {
      if (marked_[tile_index(column, row)] != 1) continue;
      PixelRect box{column, row, column + 1, row + 1};  // in tiles
      pending_.clear();
      const auto visit = [&](int c, int r) {
        if (c < 0 || c >= columns_ || r < 0 || r >= rows_) return;
        const std::size_t at = tile_index(c, r);
        if (marked_[at] != 1) return;
        marked_[at] = 2;
        (void)pending_.try_push_back(static_cast<std::uint32_t>(at));  // each tile once
      };
      visit(column, row);
      while (!pending_.empty()) {
        const auto at = static_cast<int>(pending_[pending_.size() - 1]);
        pending_.resize(pending_.size() - 1);
        const int c = at % columns_, r = at / columns_;
        box = {std::min(box.x0, c), std::min(box.y0, r), std::max(box.x1, c + 1),
               std::max(box.y1, r + 1)};
        visit(c - 1, r), visit(c + 1, r), visit(c, r - 1), visit(c, r + 1);
      }
      const PixelRect pixels{box.x0 * kTile, box.y0 * kTile, std::min(box.x1 * kTile, width_),
                             std::min(box.y1 * kTile, height_)};
      if (!regions_.try_push_back(pixels)) {  // more than 64 pieces: the whole image, then
        regions_.clear();
        (void)regions_.try_push_back({0, 0, width_, height_});
        return;
      }
    }
  while (merge_touching()) {
  }
}

bool ChangeGate::merge_touching() {
  for (std::size_t a = 0; a < regions_.size(); ++a)
    for (std::size_t b = a + 1; b < regions_.size(); ++b) {
      PixelRect& first = regions_[a];
      const PixelRect& second = regions_[b];
      if (!touch(first, second)) continue;
      first = {std::min(first.x0, second.x0), std::min(first.y0, second.y0),
               std::max(first.x1, second.x1), std::max(first.y1, second.y1)};
      regions_[b] = regions_[regions_.size() - 1];
      regions_.resize(regions_.size() - 1);
      return true;
    }
  return false;
}

void ChangeGate::keep_reference(const PixelRect& rect) {
  // Regions are made of whole tiles, or end with the image.
  const int x0 = rect.x0 / 2, x1 = rect.x1 == width_ ? sample_columns_ : rect.x1 / 2;
  const int y0 = rect.y0 / 2, y1 = rect.y1 == height_ ? sample_rows_ : rect.y1 / 2;
  for (int y = y0; y < y1; ++y) {
    const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(sample_columns_) +
                           static_cast<std::size_t>(x0);
    std::copy_n(samples_.data() + at, x1 - x0, reference_.data() + at);
  }
}

}  // namespace wagonsight
