#pragma once

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

// Images that the tests of the stereo module share. Everything is drawn from a seed.
namespace wagonsight::test {

// A textured pair with a known, stepwise disparity: the left image shows the right one shifted by
// `near` inside of the middle third and by `far` elsewhere.
struct StereoPair {
  int width = 0, height = 0;
  std::vector<std::uint16_t> left, right;
  std::vector<int> disparity;  // of the left image

  int at(int x, int y) const { return disparity[static_cast<std::size_t>(y * width + x)]; }
};

inline StereoPair textured_pair(int width, int height, int near, int far, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> gray(200, 3800);
  StereoPair pair;
  pair.width = width;
  pair.height = height;
  const auto size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  pair.left.resize(size);
  pair.right.resize(size);
  pair.disparity.resize(size);
  for (auto& pixel : pair.right) pixel = static_cast<std::uint16_t>(gray(random));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const bool middle =
          x > width / 3 && x < 2 * width / 3 && y > height / 3 && y < 2 * height / 3;
      const int d = middle ? near : far;
      const auto at = static_cast<std::size_t>(y * width + x);
      pair.disparity[at] = d;
      pair.left[at] = x >= d ? pair.right[at - static_cast<std::size_t>(d)]
                             : static_cast<std::uint16_t>(gray(random));
    }
  return pair;
}

}  // namespace wagonsight::test
