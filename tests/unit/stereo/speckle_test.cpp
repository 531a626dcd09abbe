#include "stereo/speckle.h"

#include <gmock/gmock.h>

#include <queue>
#include <random>
#include <vector>

#include "stereo/matcher_kernels.h"
#include "support/sanitized.h"

namespace wagonsight {
namespace {

using stereo_kernels::kNoDisparity;
using Disparities = std::vector<std::int16_t>;

// The obvious way: flood every region.
Disparities flooded(const Disparities& in, int width, int height, int pixels_min, int limit,
                    const SpeckleFilter::OpenEdges& open) {
  Disparities out = in;
  std::vector<bool> seen(in.size());
  for (std::size_t start = 0; start < in.size(); ++start) {
    if (seen[start] || in[start] < 0) continue;
    std::vector<std::size_t> region{start};
    seen[start] = true;
    for (std::size_t k = 0; k < region.size(); ++k) {
      const int x = static_cast<int>(region[k]) % width, y = static_cast<int>(region[k]) / width;
      for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
        if (x + dx < 0 || x + dx >= width || y + dy < 0 || y + dy >= height) continue;
        const auto next = static_cast<std::size_t>((y + dy) * width + x + dx);
        if (seen[next] || in[next] < 0 || std::abs(in[next] - in[region[k]]) > limit) continue;
        seen[next] = true;
        region.push_back(next);
      }
    }
    bool goes_on = false;
    for (const std::size_t pixel : region) {
      const int x = static_cast<int>(pixel) % width, y = static_cast<int>(pixel) / width;
      goes_on = goes_on || (x == 0 && open.left) || (y == 0 && open.top) ||
                (x == width - 1 && open.right) || (y == height - 1 && open.bottom);
    }
    if (!goes_on && static_cast<int>(region.size()) < pixels_min)
      for (const std::size_t pixel : region) out[pixel] = kNoDisparity;
  }
  return out;
}

class SpeckleSeeds : public testing::TestWithParam<int> {};

TEST_P(SpeckleSeeds, AgreesWithFlooding) {
  std::mt19937 random(static_cast<unsigned>(GetParam()));
  const auto between = [&](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
  };
  const int width = between(1, 70), height = between(1, 60), levels = between(1, 12);
  Disparities image(static_cast<std::size_t>(width * height));
  for (auto& d : image)
    d = static_cast<std::int16_t>(between(0, 4) == 0 ? kNoDisparity : between(0, levels) * 50);
  const int pixels_min = between(2, 40), limit = between(0, 120);
  const auto coin = [&] { return between(0, 3) == 0; };
  const SpeckleFilter::OpenEdges open{coin(), coin(), coin(), coin()};
  const Disparities expected = flooded(image, width, height, pixels_min, limit, open);
  SpeckleFilter filter(80, 60);
  filter.apply({image.data(), width, height}, pixels_min, limit, open);
  EXPECT_EQ(image, expected) << width << " x " << height;
}

INSTANTIATE_TEST_SUITE_P(Seeds, SpeckleSeeds, testing::Range(0, test::cases(60, 10)));

TEST(Speckle, KeepsEverythingWhenNothingIsAsked) {
  Disparities image{1, kNoDisparity, 300, 5};
  SpeckleFilter filter(2, 2);
  filter.apply({image.data(), 2, 2}, 0, 0);
  EXPECT_THAT(image, testing::ElementsAre(1, kNoDisparity, 300, 5));
}

}  // namespace
}  // namespace wagonsight
