#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"

namespace wagonsight {

// A 16-bit image as it was in its file, row by row.
struct RawImage {
  int width = 0, height = 0;
  std::vector<std::uint16_t> pixels;
};

// 16-bit greyscale PNG. `path` is told in errors. The image's memory is reused.
Result<void> read_png16(std::span<const std::byte> file, const std::string& path, RawImage& image);

// Binary PGM (P5) with a maximum above 255, so two bytes a pixel, the high one first.
Result<void> read_pgm16(std::span<const std::byte> file, const std::string& path, RawImage& image);

}  // namespace wagonsight
