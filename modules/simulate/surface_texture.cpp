#include "simulate/surface_texture.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "simulate/random.h"

namespace wagonsight {
namespace {

constexpr int kSize = SurfaceTextures::kSize;
using Tile = std::vector<float>;  // about 1

std::size_t at(int x, int y) {
  return static_cast<std::size_t>((y & (kSize - 1)) * kSize + (x & (kSize - 1)));
}

// Adds values that are random on a lattice of `cell` texels and linear in between; `amount` is
// about their standard deviation.
void add_noise(Tile& tile, int cell, float amount, std::uint64_t seed) {
  const int nodes = kSize / cell;
  const auto node = [&](int i, int j) {
    const auto key = static_cast<std::uint64_t>((j % nodes) * nodes + i % nodes);
    return static_cast<float>(uniform(mixed(seed, static_cast<std::uint64_t>(cell), key)) - 0.5) *
           3.5F;
  };
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) {
      const int i = x / cell, j = y / cell;
      const float fx = static_cast<float>(x % cell) / static_cast<float>(cell);
      const float fy = static_cast<float>(y % cell) / static_cast<float>(cell);
      const float top = node(i, j) + fx * (node(i + 1, j) - node(i, j));
      const float bottom = node(i, j + 1) + fx * (node(i + 1, j + 1) - node(i, j + 1));
      tile[at(x, y)] += amount * (top + fy * (bottom - top));
    }
}

struct Octave {
  int cell;
  float amount;
};

template <class Pattern>
void add_pattern(Tile& tile, Pattern pattern) {
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) tile[at(x, y)] += pattern(x, y);
}

float lozenge(int x, int y) {
  const int a = (x + y) % 32, b = (x - y + kSize) % 32;
  const bool line = a < 4 || b < 4;
  const bool dot = std::abs(a - 18) < 3 && std::abs(b - 18) < 3;
  return line ? 0.35F : dot ? -0.4F : 0.0F;
}

// Blocks like letters, in lines.
float letter(int x, int y, std::uint64_t seed) {
  if (y % 32 > 19 || x % 12 > 8) return -0.7F;
  const auto key =
      static_cast<std::uint64_t>((y / 32) * 4096 + (x / 12) * 64 + (y % 32) / 5 * 8 + (x % 12) / 3);
  return uniform(mixed(seed, key)) < 0.55 ? 0.8F : -0.7F;
}

Tile draw(Texture texture, std::uint64_t seed) {
  Tile tile(static_cast<std::size_t>(kSize * kSize), 1.0F);
  const auto noise = [&](std::initializer_list<Octave> octaves) {
    for (const Octave& octave : octaves) add_noise(tile, octave.cell, octave.amount, seed);
  };
  switch (texture) {
    case Texture::kPlain:
      noise({{2, 0.002F}, {16, 0.004F}, {64, 0.01F}});
      break;
    case Texture::kFloor:
      noise({{1, 0.10F}, {2, 0.12F}, {4, 0.10F}, {8, 0.06F}});
      break;
    case Texture::kLaminate:
      noise({{2, 0.04F}, {4, 0.05F}, {8, 0.05F}, {32, 0.04F}});
      break;
    case Texture::kFabric:
      add_pattern(tile, lozenge);
      noise({{2, 0.03F}, {4, 0.03F}});
      break;
    case Texture::kGrille:
      add_pattern(tile, [](int x, int) { return x % 8 < 4 ? 0.3F : -0.5F; });
      noise({{4, 0.02F}});
      break;
    case Texture::kCloth:
      noise({{1, 0.06F}, {2, 0.08F}, {4, 0.10F}, {8, 0.10F}, {32, 0.08F}});
      break;
    case Texture::kStripes:
      add_pattern(tile, [](int, int y) { return y % 16 < 8 ? 0.25F : -0.25F; });
      noise({{2, 0.04F}, {4, 0.05F}, {16, 0.05F}});
      break;
    case Texture::kSkin:
      noise({{4, 0.03F}, {8, 0.04F}, {16, 0.06F}});
      break;
    case Texture::kHair:
      noise({{1, 0.12F}, {2, 0.14F}, {8, 0.12F}});
      break;
    case Texture::kScenery:
      noise({{16, 0.12F}, {32, 0.25F}, {64, 0.25F}});
      break;
    case Texture::kText:
      add_pattern(tile, [&](int x, int y) { return letter(x, y, seed); });
      break;
  }
  return tile;
}

}  // namespace

SurfaceTextures::SurfaceTextures(std::uint64_t seed) {
  for (std::size_t i = 0; i < kTextureCount; ++i) {
    Tile tile = draw(static_cast<Texture>(i), mixed(seed, 0x7E87, i));
    int size = kSize;
    for (std::vector<std::uint8_t>& level : tiles_[i]) {
      level.resize(static_cast<std::size_t>(size * size));
      std::transform(
          tile.begin(), tile.begin() + static_cast<std::ptrdiff_t>(level.size()), level.begin(),
          [](float value) {
            return static_cast<std::uint8_t>(std::clamp(std::lround(128.0F * value), 0L, 255L));
          });
      const int half = size / 2;
      for (int y = 0; y < half; ++y)
        for (int x = 0; x < half; ++x) {
          const auto from = static_cast<std::size_t>(2 * y * size + 2 * x);
          const auto below = from + static_cast<std::size_t>(size);
          tile[static_cast<std::size_t>(y * half + x)] =
              (tile[from] + tile[from + 1] + tile[below] + tile[below + 1]) / 4;
        }
      size = half;
    }
  }
}

}  // namespace wagonsight
