#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "base/result.h"
#include "frame/image.h"
#include "stereo/aligned_array.h"
#include "stereo/gray_image.h"
#include "stereo/matcher_kernels.h"
#include "stereo/speckle.h"

// From a rectified pair of gray images to disparities: census costs over a 3x3 window, semi-global
// aggregation, sub-pixel, checked from the right image. See README.md for what it reaches.
namespace wagonsight {

using stereo_kernels::kDisparityScale;
using stereo_kernels::kNoDisparity;

enum class MatcherMode : std::uint8_t {
  kFast,      // 5x5 census; paths from the west, the east and the north: one pass over the rows
  kAccurate,  // 7x5 census; the path from the south too
};

// The defaults suit the paper's cameras; penalties are chosen by the mode.
struct MatcherOptions {
  MatcherMode mode = MatcherMode::kFast;
  int disparity_min = 0;          // pixels, 0 .. 255
  int disparity_count = 64;       // a multiple of 32, at most 256
  int uniqueness_percent = 10;    // how much the second best cost must exceed the best, 0 .. 99
  int left_right_difference = 1;  // pixels the right image's choice may differ; negative: no check
  int speckle_pixels = 100;       // smaller islands are dropped; 0: none
  int speckle_difference = 2;     // pixels of disparity between neighbours of one island
  // Least mean difference of horizontal neighbours in the 7x5 pixels around, in gray levels of
  // 4095: flat and overexposed surfaces have no disparity, whatever the paths bring there. Above
  // the imager's noise it rejects plain walls; 0: no check.
  int texture_min = 4;
  bool median = true;  // 3x3, over valid pixels
};

class StereoMatcher {
 public:
  // Allocates everything that match() will need, for images of exactly this size. The Error names
  // the option that cannot be served. `kernels` must outlive the matcher.
  static Result<StereoMatcher> create(
      int width, int height, const MatcherOptions& options,
      const stereo_kernels::Kernels& kernels = stereo_kernels::best_kernels());

  // Writes the left image's disparities, in 64ths of a pixel, kNoDisparity where the images do not
  // support a match: disparity d says that left (x, y) is right (x - d, y). Never allocates; the
  // same input gives the same bytes on every processor. One thread at a time.
  void match(const GrayImage& left, const GrayImage& right, ImageView<std::int16_t> disparity);

  // As match(), but writes only inside of `regions`, which are widened by context_px() on every
  // side for the computation. What lies elsewhere in `disparity` is kept; an island that
  // touches a region's border is not taken for a small one.
  void match_regions(const GrayImage& left, const GrayImage& right,
                     std::span<const PixelRect> regions, ImageView<std::int16_t> disparity) {
    match_regions(left, right, regions, disparity, left);
  }
  // Where of left and right no more is there than reach_left() and reach_right() of the regions:
  // `bright_as` is a whole image of the left one's mean brightness (as it was before
  // rectification), of this size. `sigma`, where it is given, gets the standard deviation of each
  // disparity in 64ths of a pixel as the match tells it, 16 or more; it means nothing where there
  // is no disparity.
  void match_regions(const GrayImage& left, const GrayImage& right,
                     std::span<const PixelRect> regions, ImageView<std::int16_t> disparity,
                     const GrayImage& bright_as, ImageView<std::uint8_t> sigma = {});
  // What is read of either image for a region, clipped to it.
  PixelRect reach_left(const PixelRect& region) const;
  PixelRect reach_right(const PixelRect& region) const;

  int width() const { return width_; }
  int height() const { return height_; }
  static constexpr int context_px() { return 8; }  // the paths' run-up
  // Of all that was allocated.
  std::size_t workspace_bytes() const;

 private:
  struct Pair {
    GrayImage left, right;
  };
  static constexpr int kGrayRows = 8;  // the census needs five; a power of two keeps % cheap
  static constexpr int kRawRows = 4;   // the window needs three
  // Strips of the accurate mode: their memory stays in the cache; a path that began 32 rows
  // further down has forgotten where it began.
  static constexpr int kStripRows = 64;
  static constexpr int kLookAheadRows = 32;

  StereoMatcher(int width, int height, const MatcherOptions& options,
                const stereo_kernels::Kernels& kernels);
  void choose_penalties();
  void allocate_rows();
  void check_images(const Pair& pair, const ImageView<std::int16_t>& disparity) const;
  void measure_brightness(const GrayImage& left);
  void match_rect(const Pair& pair, const PixelRect& inner, ImageView<std::int16_t> disparity,
                  ImageView<std::uint8_t> sigma);
  void begin_rect(const PixelRect& rect);
  void run_fast(const Pair& pair);
  void run_accurate(const Pair& pair);

  void take_in(const Pair& pair, int y);
  void compute_raw(const Pair& pair, int y);
  void compute_cost(const Pair& pair, int y, std::uint8_t* cost);
  void compute_penalties(int y, std::uint8_t* north);
  void measure_texture(int y);
  stereo_kernels::PathRow sum_forward(const Pair& pair, int y);
  stereo_kernels::PathRow upward_path(int y);
  stereo_kernels::WinnerRow winner_row();
  void finish_row(int y);
  void smooth_and_write(const PixelRect& inner, ImageView<std::int16_t> disparity,
                        ImageView<std::uint8_t> sigma);

  std::uint16_t* gray_row(AlignedArray<std::uint16_t>& ring, int y);
  std::uint8_t* raw_row(int y);
  std::int16_t* result_row(int y);
  std::size_t ring_slot(int y) const;
  int right_columns() const;  // of the right image that the rectangle can see

  const stereo_kernels::Kernels* kernels_;
  MatcherOptions options_;
  int width_;
  int height_;
  stereo_kernels::CensusShape shape_;
  std::uint8_t penalty_1_ = 0;
  int penalty_2_ = 0;        // where the image is even
  int penalty_2_least_ = 0;  // across an edge
  int penalty_slope_ = 0;    // less per two gray levels of the guide
  std::uint8_t unique_limit_[256] = {};
  std::uint32_t guide_gain_ = 0;  // 16 fractional bits: guide = gray * gain

  PixelRect rect_{};    // being matched, with its context
  int next_taken_ = 0;  // the next row to take in
  int next_raw_ = 0;    // the next row whose Hamming distances are due

  std::size_t gray_stride_ = 0, row_stride_ = 0;
  std::size_t cost_stride_ = 0, result_stride_ = 0;
  int ring_rows_ = 0;  // of costs, sums and penalties: a strip and its look-ahead, or one

  AlignedArray<std::uint16_t> left_gray_, right_gray_;  // rings; the right rows run backwards
  AlignedArray<std::uint8_t> guide_;                    // this row's and the last one's
  AlignedArray<std::uint8_t> left_planes_, right_planes_;
  AlignedArray<std::uint8_t> raw_;  // ring of Hamming distances
  AlignedArray<std::uint8_t> cost_, sum_, penalty_north_;
  AlignedArray<std::uint8_t> north_, north_min_, south_, south_min_;
  AlignedArray<std::uint8_t> penalty_west_;
  AlignedArray<std::uint8_t> winner_, winner_cost_, cost_below_, cost_above_;
  AlignedArray<std::uint8_t> right_winner_, seen_from_right_;
  AlignedArray<std::uint16_t> rises_;  // working row of measure_texture
  AlignedArray<std::uint8_t> flat_;    // 1 where a pixel has too little texture; whole image
  AlignedArray<std::uint8_t> sigma_;   // of the disparities; whole image
  AlignedArray<std::int16_t> result_, smooth_;
  SpeckleFilter speckle_;
};

}  // namespace wagonsight
