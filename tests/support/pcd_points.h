#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace wagonsight::testing_support {

// LZF as liblzf writes it; empty when the input is damaged.
inline std::vector<char> undo_lzf(const std::string& in, std::size_t size) {
  std::vector<char> out;
  for (std::size_t i = 0; i < in.size();) {
    const auto control = static_cast<unsigned char>(in[i++]);
    if (control < 32) {  // a run of literals
      const std::size_t count = control + 1U;
      if (i + count > in.size()) return {};
      out.insert(out.end(), in.begin() + static_cast<std::ptrdiff_t>(i),
                 in.begin() + static_cast<std::ptrdiff_t>(i + count));
      i += count;
      continue;
    }
    std::size_t length = control >> 5U;
    if (length == 7) length += static_cast<unsigned char>(in[i++]);
    const std::size_t back =
        (std::size_t{control & 31U} << 8U) + static_cast<unsigned char>(in[i++]);
    if (back + 1 > out.size()) return {};
    for (std::size_t k = 0; k < length + 2; ++k) out.push_back(out[out.size() - back - 1]);
  }
  return out.size() == size ? out : std::vector<char>{};
}

// The x, y, z of a compressed PCD whose first three fields they are, 4 bytes each; NaN where there
// is no point. Empty when there is no such file. For tests over recordings.
inline std::vector<Eigen::Vector3f> read_pcd(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::string line;
  std::size_t count = 0;
  while (std::getline(file, line) && line.rfind("DATA", 0) != 0) {
    if (line.rfind("POINTS ", 0) == 0) count = std::stoul(line.substr(7));
  }
  std::uint32_t sizes[2] = {0, 0};  // compressed, plain
  if (line != "DATA binary_compressed" || !file.read(reinterpret_cast<char*>(sizes), 8)) return {};
  std::string packed(sizes[0], '\0');
  file.read(packed.data(), static_cast<std::streamsize>(packed.size()));
  const std::vector<char> plain = undo_lzf(packed, sizes[1]);
  if (plain.size() < count * 12) return {};
  std::vector<Eigen::Vector3f> points(count);
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      float value = 0;
      std::memcpy(&value, plain.data() + (axis * count + i) * 4, 4);
      points[i][static_cast<Eigen::Index>(axis)] = value;
    }
  }
  return points;
}

}  // namespace wagonsight::testing_support
