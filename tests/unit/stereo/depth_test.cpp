#include "stereo/depth.h"

#include <gtest/gtest.h>

#include <vector>

#include "stereo/matcher_kernels.h"

namespace wagonsight {
namespace {

constexpr double kFocal = 520, kBaseline = 0.08;

TEST(Depth, IsFocalLengthTimesBaselineOverDisparity) {
  const DepthTable table(kFocal, kBaseline, 20.0);
  std::vector<std::int16_t> disparity;
  for (int d = -1; d < 256 * 64; d += 7) disparity.push_back(static_cast<std::int16_t>(d));
  const int count = static_cast<int>(disparity.size());
  std::vector<std::uint16_t> depth(disparity.size(), 1);
  table.convert({disparity.data(), count, 1}, {depth.data(), count, 1});
  for (std::size_t k = 0; k < disparity.size(); ++k) {
    const double metres = kFocal * kBaseline * 64 / disparity[k];
    if (disparity[k] <= 0 || metres > 20.0)
      EXPECT_EQ(depth[k], 0) << disparity[k];
    else
      EXPECT_NEAR(depth[k], metres * 1000, 0.5 + 1e-6) << disparity[k];
    EXPECT_EQ(depth[k], table.millimetres(disparity[k]));
  }
}

TEST(Depth, NoiseIsThatOfTheDisparity) {
  // A disparity that is one sigma off moves the depth by sigma(z), to first order.
  const double sigma_d = 0.25;
  const DepthNoise noise = stereo_noise(kFocal, kBaseline, sigma_d);
  for (const double z : {0.8, 1.5, 3.0, 5.0}) {
    const double d = kFocal * kBaseline / z;
    const double moved = kFocal * kBaseline / (d - sigma_d) - kFocal * kBaseline / (d + sigma_d);
    EXPECT_NEAR(noise.sigma(z) - noise.a, moved / 2, 0.01 * z * z * 0.25);
    const double step = kFocal * kBaseline / (d - 1.0 / 64) - z;
    EXPECT_NEAR(noise.step(z), step, 0.02 * step);
  }
}

}  // namespace
}  // namespace wagonsight
