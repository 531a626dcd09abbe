#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace wagonsight {

// A rectangle of pixels somebody else owns, row by row, without padding.
template <class T>
struct ImageView {
  T* pixels = nullptr;
  int width = 0;
  int height = 0;

  std::size_t pixel_count() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }
  std::size_t index(int u, int v) const {
    return static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(u);
  }
  T& at(int u, int v) const { return pixels[index(u, v)]; }
  std::span<T> span() const { return {pixels, pixel_count()}; }
};

// Raw depth: millimetres along the optical axis (z), 0 where there is no reading.
using DepthImage = ImageView<const std::uint16_t>;

enum class PixelFormat : std::uint8_t { kDepth16, kGray8, kGray16, kRgb8 };

constexpr std::size_t bytes_per_pixel(PixelFormat format) {
  switch (format) {
    case PixelFormat::kDepth16:
    case PixelFormat::kGray16:
      return 2;
    case PixelFormat::kGray8:
      return 1;
    case PixelFormat::kRgb8:
      return 3;
  }
  return 0;
}

}  // namespace wagonsight
