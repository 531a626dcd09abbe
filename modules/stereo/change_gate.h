#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "base/bounded_vector.h"
#include "base/time.h"
#include "stereo/aligned_array.h"
#include "stereo/gray_image.h"
#include "stereo/rectify.h"
#include "stereo/tile_regions.h"

// Where a pair has to be matched again: only where the image differs from what it was when that
// place was last matched. What has not changed keeps its disparity, a motionless passenger's too.
namespace wagonsight {

struct ChangeGateOptions {
  double noise_levels = 12;  // standard deviation of one pixel, in gray levels of 4095, at least
  int margin_px = 16;        // matched around what changed
  double whole_share = 0.8;  // of the whole image's cost: beyond it all of it is, as one piece
  // What has not changed is matched again as well: everything this often, a strip of rows at a
  // time, and what is fed back this often, no more at a time than an eighth of the image and one
  // of its rectangles. 0: never, and always.
  double whole_every_s = 0;
  double whole_phase_s = 0;  // so much earlier the first time: cameras take turns
  double feedback_every_s = 0;
};

// Tiles of 16 x 16 pixels are compared with the reference after the change of brightness of the
// whole image has been taken out; a tile's own offset does not count either. A tile has changed
// when the rest of its variance is above the noise, or when its mean is a fifth off. The noise is
// what half of the tiles show or less: in a tunnel's gain it is several times that of daylight.
class ChangeGate {
 public:
  ChangeGate(int width, int height, const ChangeGateOptions& options = {});

  // The regions to be matched, disjoint, clipped to the image; valid until the next call, which
  // takes them as matched at `instant`. `whole` asks for all of the image (while learning);
  // `feedback` are regions that are matched again where they did not change (of tracks and
  // foreground). The first call gives the whole image. With a table, `left` is the camera's own
  // image, which is looked at where the table says; regions are of the rectified one. Does not
  // allocate; one thread at a time.
  std::span<const PixelRect> regions(const GrayImage& left, bool whole,
                                     std::span<const PixelRect> feedback, RectifyTable table = {},
                                     HostTime instant = {});

  // Share of the tiles that differed in the last call, before margins; 0 .. 1.
  double changed_share() const { return changed_share_; }

 private:
  struct Tile {
    double mean, mean_reference, variance, variance_reference, covariance;
  };
  void take_samples(const GrayImage& image);
  template <class Gray>
  void take_samples_by_table(const GrayImage& image, RectifyTable table, unsigned scale);
  Tile measure(int column, int row) const;
  double gain_of_all();
  static double rest_of(const Tile& tile, double gain);
  double noise_of_all(double gain);
  static bool differs(const Tile& tile, double gain, double noise);
  void mark_changes();
  PixelRect tiles_of(const PixelRect& rect) const;
  void mark(const PixelRect& tiles);
  int mark_older(const PixelRect& tiles, HostTime than);
  void mark_feedback(std::span<const PixelRect> feedback, HostTime instant);
  int strips() const;
  double strip_every_s() const;
  void mark_strips(HostTime instant);
  void collect_regions();
  void keep(const PixelRect& rect, HostTime instant);
  std::size_t tile_index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }

  ChangeGateOptions options_;
  int width_, height_;
  int columns_, rows_;                // of tiles
  int sample_columns_, sample_rows_;  // means of 2 x 2 pixels, of the camera's own image
  bool has_reference_ = false;
  double changed_share_ = 0;
  AlignedArray<std::uint16_t> samples_, reference_;
  AlignedArray<std::uint8_t> marked_;  // by tile: 1 changed or asked for
  BoundedVector<HostTime> matched_;    // by tile: when
  HostTime strip_{};                   // when the last strip was due
  int next_strip_ = 0;
  BoundedVector<Tile> tiles_;
  BoundedVector<double> ratios_;
  TileRegions cover_;
  BoundedVector<PixelRect> regions_;
};

}  // namespace wagonsight
