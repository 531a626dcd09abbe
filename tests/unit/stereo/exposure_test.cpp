#include "stereo/exposure.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace wagonsight {
namespace {

constexpr int kWidth = 200, kHeight = 100, kFull = 4095;

// A scene of reflectances 0.1 .. 1 under a light; the imager saturates.
std::vector<std::uint16_t> seen(double light, const ExposureSettings& settings) {
  const double exposure = settings.shutter_us * std::pow(10.0, settings.gain_db / 20.0);
  std::vector<std::uint16_t> pixels;
  for (int k = 0; k < kWidth * kHeight; ++k) {
    const double reflectance = 0.1 + 0.9 * (k * 37 % 101) / 100.0;
    pixels.push_back(
        static_cast<std::uint16_t>(std::min(light * reflectance * exposure, double{kFull})));
  }
  return pixels;
}

ExposureStatistics statistics_of(const std::vector<std::uint16_t>& pixels) {
  return measure_exposure({pixels.data(), PixelFormat::kGray16, kWidth, kHeight}, {}, kFull);
}

// Images until the mean is within a fifth of the target, or 100.
int images_to_settle(double light, ExposureSettings& settings) {
  for (int image = 0; image < 100; ++image) {
    const auto statistics = statistics_of(seen(light, settings));
    const auto decision = next_exposure(statistics, settings);
    if (decision.usable && std::abs(statistics.mean / 0.35 - 1) < 0.2) return image;
    settings = decision.next;
  }
  return 100;
}

TEST(Exposure, StatisticsAreThoseOfTheImage) {
  std::vector<std::uint16_t> pixels(kWidth * kHeight, 0);
  for (std::size_t k = 0; k < pixels.size(); ++k) pixels[k] = k % kWidth < kWidth / 2 ? kFull : 0;
  const auto statistics = statistics_of(pixels);
  EXPECT_NEAR(statistics.mean, 0.5, 0.02);
  EXPECT_NEAR(statistics.dark_share, 0.5, 0.02);
  EXPECT_NEAR(statistics.bright_share, 0.5, 0.02);
}

TEST(Exposure, OnlyTheMaskCounts) {
  std::vector<std::uint16_t> pixels(kWidth * kHeight, 400);
  std::vector<std::uint64_t> mask((pixels.size() + 63) / 64, 0);
  for (std::size_t k = 0; k < pixels.size(); ++k) {
    const bool window = k % kWidth < 80;  // bright, and masked out
    if (window)
      pixels[k] = kFull;
    else
      mask[k / 64] |= std::uint64_t{1} << (k % 64);
  }
  const auto statistics =
      measure_exposure({pixels.data(), PixelFormat::kGray16, kWidth, kHeight}, mask, kFull);
  EXPECT_NEAR(statistics.mean, 400.0 / kFull, 1e-9);
  EXPECT_EQ(statistics.bright_share, 0);
}

TEST(Exposure, MastersATunnelsEndAndItsBeginning) {
  ExposureSettings settings;
  ASSERT_LT(images_to_settle(0.6, settings), 10);  // inside the tunnel
  const double in_tunnel = settings.shutter_us;
  // Out into the sun: a hundred times brighter; half a second at 14 images a second is seven.
  EXPECT_LE(images_to_settle(60.0, settings), 7);
  EXPECT_NEAR(settings.shutter_us, in_tunnel / 100, in_tunnel / 200);
  EXPECT_LE(images_to_settle(0.6, settings), 7);  // and back
}

TEST(Exposure, TheFirstImageInTheSunSaysThatItIsUnusable) {
  ExposureSettings settings;
  images_to_settle(0.6, settings);
  EXPECT_FALSE(next_exposure(statistics_of(seen(60.0, settings)), settings).usable);
  EXPECT_FALSE(next_exposure(statistics_of(seen(0.002, settings)), settings).usable);
}

TEST(Exposure, ASettledImageChangesNothing) {
  ExposureSettings settings;
  images_to_settle(2.0, settings);
  for (int image = 0; image < 5; ++image) {
    const auto decision = next_exposure(statistics_of(seen(2.0, settings)), settings);
    settings = decision.next;
  }
  const auto settled = next_exposure(statistics_of(seen(2.0, settings)), settings);
  EXPECT_EQ(settled.next.shutter_us, settings.shutter_us);
  EXPECT_EQ(settled.next.gain_db, settings.gain_db);
}

TEST(Exposure, GainFollowsOnlyWhenTheShutterIsAtItsEnd) {
  ExposureSettings settings;
  images_to_settle(0.05, settings);
  EXPECT_EQ(settings.shutter_us, ExposureLimits{}.shutter_us_max);
  EXPECT_GT(settings.gain_db, 0);
  images_to_settle(5.0, settings);
  EXPECT_LT(settings.shutter_us, ExposureLimits{}.shutter_us_max);
  EXPECT_EQ(settings.gain_db, 0);
}

TEST(Exposure, NothingInsideTheMaskChangesNothing) {
  const auto decision = next_exposure({}, {1234, 5});
  EXPECT_FALSE(decision.usable);
  EXPECT_EQ(decision.next.shutter_us, 1234);
}

}  // namespace
}  // namespace wagonsight
