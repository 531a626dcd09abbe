#include "stereo/alignment.h"

#include <gmock/gmock.h>

#include <cmath>
#include <vector>

namespace wagonsight {
namespace {

constexpr int kWidth = 320, kHeight = 240;

// A smooth texture that can be sampled anywhere.
double texture(double x, double y) {
  return 2000 + 500 * std::sin(0.31 * x + 0.05 * y) * std::cos(0.23 * y) +
         400 * std::sin(0.17 * x - 0.29 * y + 1) + 300 * std::cos(0.011 * x * y / 7 + 0.4 * y);
}

std::vector<std::uint16_t> image(double shift_x, double shift_y, double gain) {
  std::vector<std::uint16_t> pixels;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      pixels.push_back(static_cast<std::uint16_t>(gain * texture(x + shift_x, y + shift_y)));
  return pixels;
}

RowAlignment measured(const std::vector<std::uint16_t>& left,
                      const std::vector<std::uint16_t>& right) {
  AlignmentCheck check(kWidth, kHeight, {.disparity_count = 32});
  return check.measure({left.data(), PixelFormat::kGray16, kWidth, kHeight},
                       {right.data(), PixelFormat::kGray16, kWidth, kHeight});
}

class Offsets : public testing::TestWithParam<double> {};

TEST_P(Offsets, AreFoundToATenthOfAPixel) {
  // The right image shows at (x, y) what the left one shows at (x + 9, y - offset), darker.
  const RowAlignment found = measured(image(0, 0, 1.0), image(9, -GetParam(), 0.7));
  EXPECT_TRUE(found.reliable) << found.features;
  EXPECT_NEAR(found.median_offset_px, GetParam(), 0.1);
}
INSTANTIATE_TEST_SUITE_P(Pixels, Offsets, testing::Values(-2.5, -1.0, -0.4, 0.0, 0.3, 1.0, 2.7));

TEST(Alignment, SaysNothingOfAFlatPair) {
  const std::vector<std::uint16_t> flat(kWidth * kHeight, 1000);
  const RowAlignment found = measured(flat, flat);
  EXPECT_FALSE(found.reliable);
  EXPECT_EQ(found.features, 0);
}

TEST(Alignment, SaysNothingOfUnrelatedImages) {
  auto other = image(0, 0, 1.0);
  for (std::size_t k = 0; k < other.size(); ++k)
    other[k] = static_cast<std::uint16_t>(1000 + (k * 2654435761U >> 7) % 2000);
  EXPECT_FALSE(measured(image(0, 0, 1.0), other).reliable);
}

}  // namespace
}  // namespace wagonsight
