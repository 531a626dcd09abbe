#pragma once

#include <png.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

namespace wagonsight::testing_support {

// A 16-bit grey PNG, row by row; empty when it is not one. For tests over recordings.
inline std::vector<std::uint16_t> read_depth_png(const std::string& path, int& width, int& height) {
  std::FILE* file = std::fopen(path.c_str(), "rb");
  if (file == nullptr) return {};
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  std::vector<std::uint16_t> pixels;
  if (setjmp(png_jmpbuf(png)) == 0) {
    png_init_io(png, file);
    png_read_info(png, info);
    if (png_get_bit_depth(png, info) == 16 && png_get_channels(png, info) == 1) {
      width = static_cast<int>(png_get_image_width(png, info));
      height = static_cast<int>(png_get_image_height(png, info));
      png_set_swap(png);
      pixels.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
      for (int v = 0; v < height; ++v) {
        png_read_row(
            png,
            reinterpret_cast<png_bytep>(pixels.data() + static_cast<std::ptrdiff_t>(v) * width),
            nullptr);
      }
    }
  }
  png_destroy_read_struct(&png, &info, nullptr);
  std::fclose(file);
  return pixels;
}

// The images of a folder in the order of their names; empty when there is no such folder.
inline std::vector<std::vector<std::uint16_t>> read_depth_folder(const std::string& folder) {
  std::vector<std::string> paths;
  if (std::filesystem::is_directory(folder)) {
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
      if (entry.path().extension() == ".png") paths.push_back(entry.path().string());
    }
  }
  std::sort(paths.begin(), paths.end());
  std::vector<std::vector<std::uint16_t>> images;
  int width = 0, height = 0;
  for (const std::string& path : paths) images.push_back(read_depth_png(path, width, height));
  return images;
}

}  // namespace wagonsight::testing_support
