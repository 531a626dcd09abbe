#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "geometry/camera.h"

namespace wagonsight {

// The ray (x, y, 1) through a pixel as two 16-bit fixed-point numbers with 14 fractional bits
// (range +-2, step 6e-5: 0.2 mm at 3.5 m). kNoRay in x marks a pixel whose distortion has no
// inverse or whose ray is outside of that range (wider than 63 degrees off the axis).
struct PixelRay {
  std::int16_t x;
  std::int16_t y;
};
inline constexpr float kRayScale = 1.0F / 16384.0F;
inline constexpr std::int16_t kNoRay = INT16_MIN;

// One PixelRay a pixel, row by row; a view into the blob or into a vector made at start-up.
using RayTable = std::span<const PixelRay>;

// Computes the table of a camera, width * height entries (the whole of its distortion is folded
// in). Allocates; about 40 ms for a distorted 640 x 480 camera.
std::vector<PixelRay> make_ray_table(const Camera& camera);

}  // namespace wagonsight
