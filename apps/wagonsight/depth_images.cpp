#include "depth_images.h"

#include <fmt/format.h>
#include <png.h>

#include <csetjmp>
#include <cstring>
#include <string_view>

#include "base/capacities.h"

namespace wagonsight {
namespace {

struct PngInput {
  std::span<const std::byte> rest;
  char message[120] = "";
};

void read_bytes(png_structp png, png_bytep out, png_size_t size) {
  auto* input = static_cast<PngInput*>(png_get_io_ptr(png));
  if (size > input->rest.size()) png_error(png, "the file ends within the image");
  std::memcpy(out, input->rest.data(), size);
  input->rest = input->rest.subspan(size);
}

[[noreturn]] void on_error(png_structp png, png_const_charp message) {
  auto* input = static_cast<PngInput*>(png_get_error_ptr(png));
  std::strncpy(input->message, message, sizeof input->message - 1);
  png_longjmp(png, 1);
}

void on_warning(png_structp /*png*/, png_const_charp /*message*/) {}

struct PngShape {
  png_uint_32 width = 0, height = 0;
  int bit_depth = 0, color_type = 0;
  bool is_wanted() const { return bit_depth == 16 && color_type == PNG_COLOR_TYPE_GRAY; }
  bool is_too_large() const { return height == 0 || width > kImagePixelsMax / std::size_t{height}; }
};

// libpng leaves by longjmp, so these functions own nothing.
bool read_header(png_structp png, png_infop info, PngShape& shape) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;  // NOLINT: libpng's error handling
  png_read_info(png, info);
  png_get_IHDR(png, info, &shape.width, &shape.height, &shape.bit_depth, &shape.color_type, nullptr,
               nullptr, nullptr);
  return true;
}

bool read_rows(png_structp png, png_infop info, png_bytepp rows) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;  // NOLINT: libpng's error handling
  png_set_swap(png);                               // PNG has the high byte first
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  png_read_image(png, rows);
  png_read_end(png, nullptr);
  return true;
}

std::string_view color_text(int color_type) {
  switch (color_type) {
    case PNG_COLOR_TYPE_GRAY:
      return "grey";
    case PNG_COLOR_TYPE_PALETTE:
      return "palette";
    case PNG_COLOR_TYPE_GRAY_ALPHA:
      return "grey and alpha";
    default:
      return "colour";
  }
}

Result<void> read_opened_png(png_structp png, png_infop info, const PngInput& input,
                             const std::string& path, RawImage& image) {
  PngShape shape;
  if (!read_header(png, info, shape))
    return fail(fmt::format("{} is a damaged PNG: {}", path, input.message));
  if (!shape.is_wanted())
    return fail(fmt::format(
        "{} is a PNG of {}-bit {}; depth must be 16-bit grey (millimetres, 0 for no reading)", path,
        shape.bit_depth, color_text(shape.color_type)));
  if (shape.is_too_large())
    return fail(fmt::format("{} is {} x {} pixels; at most {} pixels are accepted", path,
                            shape.width, shape.height, kImagePixelsMax));
  image.width = static_cast<int>(shape.width);
  image.height = static_cast<int>(shape.height);
  image.pixels.resize(std::size_t{shape.width} * shape.height);
  std::vector<png_bytep> rows(shape.height);
  for (std::size_t v = 0; v < rows.size(); ++v)
    rows[v] = reinterpret_cast<png_bytep>(image.pixels.data() + v * shape.width);
  if (!read_rows(png, info, rows.data()))
    return fail(fmt::format("{} is a damaged PNG: {}", path, input.message));
  return {};
}

// The next number of a PGM's head, behind white space and comments; -1 where there is none.
long next_number(std::string_view text, std::size_t& at) {
  while (at < text.size()) {
    if (text[at] == '#') {
      while (at < text.size() && text[at] != '\n') ++at;
    } else if (std::isspace(static_cast<unsigned char>(text[at])) != 0) {
      ++at;
    } else {
      break;
    }
  }
  long value = -1;
  constexpr long kLimit = 100'000'000;
  while (at < text.size() && text[at] >= '0' && text[at] <= '9' && value < kLimit)
    value = (value < 0 ? 0 : value * 10) + (text[at++] - '0');
  return value;
}

}  // namespace

Result<void> read_png16(std::span<const std::byte> file, const std::string& path, RawImage& image) {
  constexpr std::size_t kSignatureBytes = 8;
  if (file.size() < kSignatureBytes ||
      png_sig_cmp(reinterpret_cast<png_const_bytep>(file.data()), 0, kSignatureBytes) != 0)
    return fail(fmt::format("{} is not a PNG image, whatever its name says", path));
  PngInput input{.rest = file};
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &input, on_error, on_warning);
  png_infop info = png == nullptr ? nullptr : png_create_info_struct(png);
  if (info == nullptr) {
    png_destroy_read_struct(&png, nullptr, nullptr);
    return fail(fmt::format("{} cannot be read: no memory", path));
  }
  png_set_read_fn(png, &input, read_bytes);
  auto done = read_opened_png(png, info, input, path, image);
  png_destroy_read_struct(&png, &info, nullptr);
  return done;
}

Result<void> read_pgm16(std::span<const std::byte> file, const std::string& path, RawImage& image) {
  const std::string_view text{reinterpret_cast<const char*>(file.data()), file.size()};
  if (text.substr(0, 2) != "P5")
    return fail(fmt::format("{} is not a binary PGM image (it does not begin with P5)", path));
  std::size_t at = 2;
  const long width = next_number(text, at);
  const long height = next_number(text, at);
  const long maximum = next_number(text, at);
  if (width <= 0 || height <= 0 || maximum <= 0)
    return fail(
        fmt::format("{} is a damaged PGM: its head has no width, height and maximum", path));
  if (maximum <= 255 || maximum > 65'535)
    return fail(
        fmt::format("{} is a PGM with the maximum {}; depth must have 16 bits (a maximum "
                    "of 256 to 65535)",
                    path, maximum));
  if (static_cast<std::size_t>(width) > kImagePixelsMax / static_cast<std::size_t>(height))
    return fail(fmt::format("{} is {} x {} pixels; at most {} pixels are accepted", path, width,
                            height, kImagePixelsMax));
  ++at;  // the one white space behind the head
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  if (at > file.size() || file.size() - at < pixels * 2)
    return fail(fmt::format("{} is a damaged PGM: the file ends within the image", path));
  image.width = static_cast<int>(width);
  image.height = static_cast<int>(height);
  image.pixels.resize(pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    const auto high = std::to_integer<unsigned>(file[at + 2 * i]);
    const auto low = std::to_integer<unsigned>(file[at + 2 * i + 1]);
    image.pixels[i] = static_cast<std::uint16_t>(high << 8U | low);
  }
  return {};
}

}  // namespace wagonsight
