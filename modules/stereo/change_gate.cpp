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
// The matcher's run-up around a region, its window and its census.
constexpr double kAroundRegion_px = 12;
// Whole images are matched again by strips of so many rows of tiles, in a part of the time that
// there is; so what was matched in the rest of it is left out and nothing waits for longer.
constexpr int kStripTiles = 4;
constexpr double kStripsTime = 0.8;
constexpr int kFeedbackShare = 8;  // one in so many tiles at a time

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

}  // namespace

ChangeGate::ChangeGate(int width, int height, const ChangeGateOptions& options)
    : options_(options),
      width_(width),
      height_(height),
      columns_((width + kTile - 1) / kTile),
      rows_((height + kTile - 1) / kTile),
      sample_columns_(columns_ * kTileSamples),
      sample_rows_(rows_ * kTileSamples),
      cover_(columns_, rows_, kAroundRegion_px / kTile) {
  WS_CHECK(width > 0 && height > 0, "%d x %d", width, height);
  const std::size_t tile_count =
      static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  samples_ = AlignedArray<std::uint16_t>(tile_count * kTileSamples * kTileSamples);
  reference_ = AlignedArray<std::uint16_t>(samples_.size());
  marked_ = AlignedArray<std::uint8_t>(tile_count);
  tiles_ = BoundedVector<Tile>(tile_count);
  ratios_ = BoundedVector<double>(tile_count);
  matched_ = BoundedVector<HostTime>(tile_count);
  matched_.resize(tile_count);
  regions_ = BoundedVector<PixelRect>(TileRegions::kRegionsMax);
}

std::span<const PixelRect> ChangeGate::regions(const GrayImage& left, bool whole,
                                               std::span<const PixelRect> feedback,
                                               RectifyTable table, HostTime instant) {
  WS_CHECK(left.width == width_ && left.height == height_, "%d x %d, made for %d x %d", left.width,
           left.height, width_, height_);
  if (table.empty())
    take_samples(left);
  else if (left.format == PixelFormat::kGray8)
    take_samples_by_table<std::uint8_t>(left, table, 16);
  else
    take_samples_by_table<std::uint16_t>(left, table, 1);
  std::fill_n(marked_.data(), marked_.size(), std::uint8_t{0});
  if (!has_reference_ && options_.whole_every_s > 0)
    strip_ = instant - from_seconds(std::fmod(options_.whole_phase_s, strip_every_s()));
  regions_.clear();
  if (has_reference_) mark_changes();
  if (whole || !has_reference_) {
    (void)regions_.try_push_back({0, 0, width_, height_});  // there is room: it was cleared
  } else {
    mark_feedback(feedback, instant);
    mark_strips(instant);
    collect_regions();
  }
  for (const PixelRect& region : regions_) keep(region, instant);
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
      mark(tiles_of({column * kTile, row * kTile, (column + 1) * kTile, (row + 1) * kTile}));
    }
  changed_share_ = static_cast<double>(changed) / static_cast<double>(tiles_.size());
}

// With the margin; empty where the rectangle is, or lies outside.
PixelRect ChangeGate::tiles_of(const PixelRect& rect) const {
  if (rect.empty()) return {};
  const int margin = options_.margin_px;
  return {std::max(rect.x0 - margin, 0) / kTile, std::max(rect.y0 - margin, 0) / kTile,
          std::min((rect.x1 - 1 + margin) / kTile + 1, columns_),
          std::min((rect.y1 - 1 + margin) / kTile + 1, rows_)};
}

void ChangeGate::mark(const PixelRect& tiles) {
  for (int row = tiles.y0; row < tiles.y1; ++row)
    for (int column = tiles.x0; column < tiles.x1; ++column) marked_[tile_index(column, row)] = 1;
}

// Marks those that were matched before; returns how many were not marked yet.
int ChangeGate::mark_older(const PixelRect& tiles, HostTime than) {
  int count = 0;
  for (int row = tiles.y0; row < tiles.y1; ++row)
    for (int column = tiles.x0; column < tiles.x1; ++column) {
      const std::size_t tile = tile_index(column, row);
      if (marked_[tile] != 0 || matched_[tile] > than) continue;
      marked_[tile] = 1;
      ++count;
    }
  return count;
}

// Who moves is matched anyway; of the others some at a time, whose turn then is over for a while.
void ChangeGate::mark_feedback(std::span<const PixelRect> feedback, HostTime instant) {
  int room = std::max(columns_ * rows_ / kFeedbackShare, 1);
  for (const PixelRect& rect : feedback) {
    if (room <= 0 && options_.feedback_every_s > 0) return;
    room -= mark_older(tiles_of(rect), instant - from_seconds(options_.feedback_every_s));
  }
}

int ChangeGate::strips() const {
  return (rows_ + kStripTiles - 1) / kStripTiles;
}

double ChangeGate::strip_every_s() const {
  return kStripsTime * options_.whole_every_s / strips();
}

// What is due of the slow rhythm.
void ChangeGate::mark_strips(HostTime instant) {
  if (options_.whole_every_s <= 0) return;
  const Duration turn = from_seconds(strip_every_s());
  for (int due = 0; due < strips() && instant - strip_ >= turn; ++due) {
    strip_ += turn;
    const int first = next_strip_ * kStripTiles;
    next_strip_ = (next_strip_ + 1) % strips();
    (void)mark_older({0, first, columns_, std::min(first + kStripTiles, rows_)},
                     instant - from_seconds((1 - kStripsTime) * options_.whole_every_s));
  }
  if (instant - strip_ >= turn) strip_ = instant;  // after a gap all of it was due
}

void ChangeGate::collect_regions() {
  for (const PixelRect& tiles : cover_.cover({marked_.data(), marked_.size()}))
    (void)regions_.try_push_back({tiles.x0 * kTile, tiles.y0 * kTile,  // has room for as many
                                  std::min(tiles.x1 * kTile, width_),
                                  std::min(tiles.y1 * kTile, height_)});
  if (cover_.cost() <= options_.whole_share * cover_.cost_of_all()) return;
  regions_.clear();
  (void)regions_.try_push_back({0, 0, width_, height_});
}

// As matched now, with what it looks like.
void ChangeGate::keep(const PixelRect& rect, HostTime instant) {
  // Regions are made of whole tiles, or end with the image.
  const int x0 = rect.x0 / 2, x1 = rect.x1 == width_ ? sample_columns_ : rect.x1 / 2;
  const int y0 = rect.y0 / 2, y1 = rect.y1 == height_ ? sample_rows_ : rect.y1 / 2;
  for (int y = y0; y < y1; ++y) {
    const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(sample_columns_) +
                           static_cast<std::size_t>(x0);
    std::copy_n(samples_.data() + at, x1 - x0, reference_.data() + at);
  }
  for (int row = rect.y0 / kTile; row * kTile < rect.y1; ++row)
    for (int column = rect.x0 / kTile; column * kTile < rect.x1; ++column)
      matched_[tile_index(column, row)] = instant;
}

}  // namespace wagonsight
