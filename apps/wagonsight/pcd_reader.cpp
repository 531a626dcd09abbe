#include "pcd_reader.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string_view>

#include "base/capacities.h"

namespace wagonsight {
namespace {

struct Field {
  std::string_view name;
  std::size_t size = 4, count = 1;
  char type = 'F';
  std::size_t offset = 0;  // bytes within a point
};

struct Header {
  std::vector<Field> fields;
  std::size_t width = 0, height = 0, point_bytes = 0;
  std::string_view data;
  std::size_t data_at = 0;
};

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  std::size_t at = 0;
  while (true) {
    at = line.find_first_not_of(" \t\r\n", at);
    if (at == std::string_view::npos) return words;
    const std::size_t end = std::min(line.find_first_of(" \t\r\n", at), line.size());
    words.push_back(line.substr(at, end - at));
    at = end;
  }
}

std::size_t to_size(std::string_view word) {
  std::size_t value = 0;
  std::from_chars(word.data(), word.data() + word.size(), value);
  return value;
}

// False where the line says something impossible.
bool take_line(const std::vector<std::string_view>& words, Header& header) {
  const std::string_view key = words[0];
  if (key == "FIELDS") {
    header.fields.resize(words.size() - 1);
    for (std::size_t i = 1; i < words.size(); ++i) header.fields[i - 1].name = words[i];
    return true;
  }
  if (key == "WIDTH" && words.size() == 2) header.width = to_size(words[1]);
  if (key == "HEIGHT" && words.size() == 2) header.height = to_size(words[1]);
  if (key != "SIZE" && key != "TYPE" && key != "COUNT") return true;
  if (words.size() - 1 != header.fields.size()) return false;
  constexpr std::size_t kCountMax = 4096;  // of a descriptor; more is a damaged file
  for (std::size_t i = 0; i < header.fields.size(); ++i) {
    Field& field = header.fields[i];
    if (key == "SIZE") field.size = to_size(words[i + 1]);
    if (key == "COUNT") field.count = to_size(words[i + 1]);
    if (key == "TYPE") field.type = words[i + 1][0];
    if (field.size == 0 || field.size > 8 || field.count == 0 || field.count > kCountMax)
      return false;
  }
  return true;
}

bool read_header(std::string_view text, Header& header) {
  std::size_t at = 0;
  while (at < text.size()) {
    const std::size_t end = text.find('\n', at);
    if (end == std::string_view::npos) return false;
    const auto words = words_of(text.substr(at, end - at));
    at = end + 1;
    if (words.empty() || words[0][0] == '#') continue;
    if (!take_line(words, header)) return false;
    if (words[0] != "DATA") continue;
    if (words.size() != 2) return false;
    header.data = words[1];
    header.data_at = at;
    for (Field& field : header.fields) {
      field.offset = header.point_bytes;
      header.point_bytes += field.size * field.count;
    }
    return !header.fields.empty();
  }
  return false;
}

// Marc Lehmann's LZF, as PCL packs with: a control byte below 32 begins a run of literals, others
// are a length of 3 bits and a distance back of 13.
bool unpack_lzf(std::span<const std::byte> in, std::span<std::byte> out) {
  std::size_t from = 0;
  std::size_t to = 0;
  while (from < in.size()) {
    const auto control = std::to_integer<std::size_t>(in[from++]);
    if (control < 32) {
      const std::size_t count = control + 1;
      if (count > in.size() - from || count > out.size() - to) return false;
      std::memcpy(out.data() + to, in.data() + from, count);
      from += count;
      to += count;
      continue;
    }
    std::size_t count = control >> 5U;
    if (count == 7) {
      if (from >= in.size()) return false;
      count += std::to_integer<std::size_t>(in[from++]);
    }
    count += 2;
    if (from >= in.size()) return false;
    const std::size_t back = ((control & 31U) << 8U | std::to_integer<std::size_t>(in[from++])) + 1;
    if (back > to || count > out.size() - to) return false;
    for (std::size_t i = 0; i < count; ++i, ++to) out[to] = out[to - back];  // may overlap
  }
  return to == out.size();
}

float to_float(const std::byte* bytes, std::size_t size) {
  if (size == sizeof(double)) {
    double value = 0;
    std::memcpy(&value, bytes, sizeof value);
    return static_cast<float>(value);
  }
  float value = 0;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}

// `stride` bytes from one point's value to the next.
void take_column(const std::byte* first, std::size_t stride, std::size_t size, std::size_t axis,
                 OrganisedCloud& cloud) {
  for (std::size_t i = 0; i < cloud.points.size(); ++i)
    cloud.points[i][axis] = to_float(first + i * stride, size);
}

using Axes = std::array<std::size_t, 3>;  // index of the fields x, y, z

bool read_binary(std::span<const std::byte> data, const Header& header, const Axes& axes,
                 OrganisedCloud& cloud) {
  if (data.size() < header.point_bytes * cloud.points.size()) return false;
  for (std::size_t axis = 0; axis < axes.size(); ++axis) {
    const Field& field = header.fields[axes[axis]];
    take_column(data.data() + field.offset, header.point_bytes, field.size, axis, cloud);
  }
  return true;
}

// Two sizes, then all x, all y, ... packed together.
bool read_compressed(std::span<const std::byte> data, const Header& header, const Axes& axes,
                     OrganisedCloud& cloud) {
  std::array<std::uint32_t, 2> sizes{};
  if (data.size() < sizeof sizes) return false;
  std::memcpy(sizes.data(), data.data(), sizeof sizes);
  data = data.subspan(sizeof sizes);
  if (sizes[0] > data.size() || sizes[1] != header.point_bytes * cloud.points.size()) return false;
  std::vector<std::byte> columns(sizes[1]);
  if (!unpack_lzf(data.first(sizes[0]), columns)) return false;
  for (std::size_t axis = 0; axis < axes.size(); ++axis) {
    const Field& field = header.fields[axes[axis]];
    take_column(columns.data() + field.offset * cloud.points.size(), field.size * field.count,
                field.size, axis, cloud);
  }
  return true;
}

bool read_ascii(std::string_view text, const Header& header, const Axes& axes,
                OrganisedCloud& cloud) {
  std::array<std::size_t, 3> columns{};
  for (std::size_t axis = 0; axis < axes.size(); ++axis)
    for (std::size_t i = 0; i < axes[axis]; ++i) columns[axis] += header.fields[i].count;
  std::size_t at = 0;
  for (auto& point : cloud.points) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const auto words = words_of(text.substr(at, end - at));
    at = std::min(end + 1, text.size());
    for (std::size_t axis = 0; axis < columns.size(); ++axis) {
      if (columns[axis] >= words.size()) return false;
      const std::string_view word = words[columns[axis]];
      point[axis] = std::numeric_limits<float>::quiet_NaN();  // also where the text says nan
      std::from_chars(word.data(), word.data() + word.size(), point[axis]);
    }
  }
  return true;
}

bool find_axes(const Header& header, Axes& axes) {
  constexpr std::array<std::string_view, 3> kNames{"x", "y", "z"};
  for (std::size_t axis = 0; axis < kNames.size(); ++axis) {
    bool is_found = false;
    for (std::size_t i = 0; i < header.fields.size(); ++i) {
      const Field& field = header.fields[i];
      if (field.name != kNames[axis] || field.type != 'F' || field.count != 1 ||
          (field.size != sizeof(float) && field.size != sizeof(double)))
        continue;
      axes[axis] = i;
      is_found = true;
    }
    if (!is_found) return false;
  }
  return true;
}

}  // namespace

Result<void> read_pcd(std::span<const std::byte> file, const std::string& path,
                      OrganisedCloud& cloud) {
  const std::string_view text{reinterpret_cast<const char*>(file.data()), file.size()};
  Header header;
  if (!read_header(text, header))
    return fail(fmt::format("{} is not a PCD cloud, or its head is damaged", path));
  Axes axes{};
  if (!find_axes(header, axes))
    return fail(fmt::format("{} has no fields x, y and z of floating point", path));
  if (header.height <= 1 || header.width <= 1)
    return fail(
        fmt::format("{} is {} x {} points, which is not organised; one point a pixel is "
                    "needed",
                    path, header.width, header.height));
  if (header.width > kImagePixelsMax / header.height)
    return fail(fmt::format("{} is {} x {} points; at most {} are accepted", path, header.width,
                            header.height, kImagePixelsMax));
  cloud.width = static_cast<int>(header.width);
  cloud.height = static_cast<int>(header.height);
  cloud.points.resize(header.width * header.height);
  bool is_whole = false;
  if (header.data == "ascii") {
    is_whole = read_ascii(text.substr(header.data_at), header, axes, cloud);
  } else if (header.data == "binary") {
    is_whole = read_binary(file.subspan(header.data_at), header, axes, cloud);
  } else if (header.data == "binary_compressed") {
    is_whole = read_compressed(file.subspan(header.data_at), header, axes, cloud);
  } else {
    return fail(fmt::format("{} has DATA {}; known are ascii, binary and binary_compressed", path,
                            header.data));
  }
  if (!is_whole)
    return fail(fmt::format("{} is a damaged PCD: its points are not all there", path));
  return {};
}

}  // namespace wagonsight
