#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "base/bounded_vector.h"
#include "base/capacities.h"

// What moved in one sensor's image: the result of lines 4 to 14 of the paper's Algorithm 1.
namespace wagonsight {

// One voxel of foreground: the mean of its pixels' points, in world coordinates (metres).
struct ForegroundPoint {
  float x = 0, y = 0, z = 0;
  float sigma = 0;           // of the sensor's noise at that depth, metres along the ray
  std::uint16_t pixels = 0;  // that fell into the voxel
  std::uint16_t blob = 0;    // index into Foreground::blobs
};

// A connected region of foreground in the image plane that is large enough in physical size.
struct Blob {
  std::uint16_t u_min = 0, v_min = 0, u_max = 0, v_max = 0;  // inclusive
  std::uint32_t pixels = 0;
  float area_m2 = 0;     // sum over its pixels of depth^2 / (fx fy)
  float depth_mean = 0;  // metres
};

// Written by ForegroundExtractor::extract into memory that is there from the start.
struct Foreground {
  explicit Foreground(std::size_t pixel_count)
      : mask((pixel_count + 63) / 64), blobs(kBlobsMax), points(kSensorPointsMax) {
    mask.resize(mask.capacity());
  }

  // Nothing moved.
  void clear() {
    std::fill(mask.begin(), mask.end(), std::uint64_t{0});
    blobs.clear();
    points.clear();
    points_dropped = 0;
  }

  std::uint8_t sensor_index = 0;
  bool background_known = false;      // false while learning: nothing is foreground then
  BoundedVector<std::uint64_t> mask;  // a bit a pixel, row by row, after the blob threshold
  BoundedVector<Blob> blobs;
  BoundedVector<ForegroundPoint> points;  // grouped by blob
  std::uint32_t points_dropped = 0;       // did not fit
};

}  // namespace wagonsight
