#pragma once

#include <cstddef>
#include <cstdint>

#include "base/bounded_vector.h"
#include "stereo/gray_image.h"

// Has the pair kept its calibration? Distinct corners of the rectified left image are sought in the
// right one, up and down as well as sideways; in a healthy pair they lie on their own row.
namespace wagonsight {

struct RowAlignment {
  int features = 0;             // that were found in both images
  double median_offset_px = 0;  // right row minus left row; the fault figure is its size
  double spread_px = 0;         // median absolute deviation from it
  bool reliable = false;        // enough features, and their offsets agree
};

struct AlignmentOptions {
  int disparity_min = 0;  // pixels, as the matcher's
  int disparity_count = 64;
  int rows_searched = 4;  // up and down, 1 .. 8; an offset beyond is not found
  int cell_px = 48;       // one corner at most is taken of each square of this size
  int features_min = 12;  // fewer say nothing
  double correlation_min = 0.9;
};

// A slow check (some milliseconds at 769 x 448), for once in some seconds, in bands of rows that
// may come from one instant after the other. Allocates at construction only; one thread at a time.
//
//     begin() -> measure_band() for each band -> result()
class AlignmentCheck {
 public:
  explicit AlignmentCheck(int width, int height, const AlignmentOptions& options = {});

  int bands() const { return bands_; }
  // What is read of either image for a band.
  PixelRect rows_of(int band) const;
  void begin() { offsets_.clear(); }
  void measure_band(const GrayImage& left, const GrayImage& right, int band);
  RowAlignment result();

  // All bands of one pair.
  RowAlignment measure(const GrayImage& left, const GrayImage& right);

 private:
  struct Corner {
    int x, y;
  };
  // The rows in which a band's corners are sought.
  int first_row(int band) const;
  int end_row(int band) const;
  void find_corners(const GrayImage& left, int band);
  Corner best_corner(const GrayImage& left, int x0, int y0, int x1, int y1, double& strength) const;
  void find_offset(const GrayImage& left, const GrayImage& right, const Corner& corner);

  AlignmentOptions options_;
  int width_, height_, bands_;
  BoundedVector<Corner> corners_;
  BoundedVector<float> offsets_;
  BoundedVector<float> deviations_;
};

}  // namespace wagonsight
