#include "png_writer.h"

#include <fmt/format.h>
#include <png.h>

#include <csetjmp>
#include <vector>

#include "files.h"

namespace wagonsight {
namespace {

void append_bytes(png_structp png, png_bytep bytes, png_size_t size) {
  auto* out = static_cast<std::vector<std::byte>*>(png_get_io_ptr(png));
  const auto* first = reinterpret_cast<const std::byte*>(bytes);
  out->insert(out->end(), first, first + size);
}

// libpng leaves by longjmp, so this owns nothing.
bool encode(png_structp png, png_infop info, png_uint_32 width, png_uint_32 height,
            png_bytepp rows) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;  // NOLINT: libpng's error handling
  constexpr int kFastest = 1;
  png_set_compression_level(png, kFastest);
  png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
  png_set_IHDR(png, info, width, height, 16, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  png_set_swap(png);  // PNG has the high byte first
  png_write_image(png, rows);
  png_write_end(png, nullptr);
  return true;
}

}  // namespace

Result<void> write_png16(const std::string& path, std::span<const std::uint16_t> pixels, int width,
                         int height) {
  std::vector<png_bytep> rows(static_cast<std::size_t>(height));
  for (std::size_t v = 0; v < rows.size(); ++v) {
    const std::uint16_t* row = pixels.data() + v * static_cast<std::size_t>(width);
    // libpng only reads them, but its type does not say so.
    rows[v] = const_cast<png_bytep>(reinterpret_cast<png_const_bytep>(row));  // NOLINT
  }
  std::vector<std::byte> bytes;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png == nullptr ? nullptr : png_create_info_struct(png);
  bool is_encoded = false;
  if (info != nullptr) {
    png_set_write_fn(png, &bytes, append_bytes, nullptr);
    is_encoded = encode(png, info, static_cast<png_uint_32>(width),
                        static_cast<png_uint_32>(height), rows.data());
  }
  png_destroy_write_struct(&png, &info);
  if (!is_encoded) return fail(fmt::format("{} cannot be encoded as PNG", path));
  return write_file(path, bytes);
}

}  // namespace wagonsight
