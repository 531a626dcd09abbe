#pragma once

#include "frame/image.h"

namespace wagonsight {

// A gray image somebody else owns, rows without padding: kGray8, or kGray16 with values below 2^15
// (a 12-bit camera's as they come; larger ones are taken as 32767).
struct GrayImage {
  const void* pixels = nullptr;
  PixelFormat format = PixelFormat::kGray8;
  int width = 0;
  int height = 0;
};

// Rows and columns of an image: [x0, x1) and [y0, y1).
struct PixelRect {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;

  bool operator==(const PixelRect&) const = default;
  bool empty() const { return x1 <= x0 || y1 <= y0; }
};

}  // namespace wagonsight
