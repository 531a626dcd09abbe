#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace wagonsight {

// What a surface looks like in visible light, besides how bright it is.
enum class Texture : std::uint8_t {
  kPlain,     // painted panels: hardly anything to match
  kFloor,     // speckled
  kLaminate,  // walls below the windows
  kFabric,    // seats: a lozenge that repeats every 96 mm
  kGrille,    // heater slots that repeat every 24 mm
  kCloth,
  kStripes,  // a jersey, 48 mm from stripe to stripe
  kSkin,
  kHair,
  kScenery,  // what passes by outside
  kText,     // what runs over a screen
};
inline constexpr std::size_t kTextureCount = 11;

// A tile of every texture, periodic in both directions, in coarser and coarser levels: what is
// finer than a pixel would glitter differently in the two imagers. 0.9 MB; allocates when made.
class SurfaceTextures {
 public:
  static constexpr int kSize = 256;  // texels of a tile
  static constexpr float kTexelsPerM = 1000 / 3.0F;

  explicit SurfaceTextures(std::uint64_t seed);

  // How much brighter than the mean the texture is at (a, b), in texels of the finest level within
  // +-16000; about 1. `footprint` is the size of a pixel in texels.
  float sample(Texture texture, float a, float b, float footprint) const;

 private:
  static constexpr int kLevels = 5;
  // Of 128ths, by texture and level.
  std::array<std::array<std::vector<std::uint8_t>, kLevels>, kTextureCount> tiles_;
};

inline float SurfaceTextures::sample(Texture texture, float a, float b, float footprint) const {
  const auto level =
      static_cast<unsigned>((footprint > 1.4F ? 1 : 0) + (footprint > 2.8F ? 1 : 0) +
                            (footprint > 5.6F ? 1 : 0) + (footprint > 11.2F ? 1 : 0));
  const auto mask = static_cast<unsigned>(kSize >> level) - 1U;
  const float scale = 1.0F / static_cast<float>(1U << level);
  // A multiple of every tile, so that truncation rounds down.
  const float x = a * scale + 16384.0F, y = b * scale + 16384.0F;
  const auto ix = static_cast<unsigned>(static_cast<int>(x)),
             iy = static_cast<unsigned>(static_cast<int>(y));
  const float fx = x - static_cast<float>(ix), fy = y - static_cast<float>(iy);
  const std::uint8_t* tile = tiles_[static_cast<std::size_t>(texture)][level].data();
  const std::uint8_t* upper = tile + static_cast<std::size_t>((iy & mask) * (mask + 1U));
  const std::uint8_t* lower = tile + static_cast<std::size_t>(((iy + 1U) & mask) * (mask + 1U));
  const unsigned left = ix & mask, right = (ix + 1U) & mask;
  const float top = static_cast<float>(upper[left]) +
                    fx * static_cast<float>(static_cast<int>(upper[right]) - upper[left]);
  const float bottom = static_cast<float>(lower[left]) +
                       fx * static_cast<float>(static_cast<int>(lower[right]) - lower[left]);
  return (top + fy * (bottom - top)) * (1.0F / 128.0F);
}

}  // namespace wagonsight
