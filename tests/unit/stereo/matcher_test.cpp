#include "stereo/matcher.h"

#include <gmock/gmock.h>

#include <cmath>
#include <random>
#include <vector>

#include "random_images.h"
#include "support/sanitized.h"

namespace wagonsight {
namespace {

using Disparities = std::vector<std::int16_t>;
using test::StereoPair;

GrayImage gray16(const std::vector<std::uint16_t>& pixels, int width, int height) {
  return {pixels.data(), PixelFormat::kGray16, width, height};
}

Disparities matched(const StereoPair& pair, const MatcherOptions& options,
                    const stereo_kernels::Kernels& kernels = stereo_kernels::best_kernels()) {
  auto matcher = StereoMatcher::create(pair.width, pair.height, options, kernels);
  EXPECT_TRUE(matcher);
  Disparities out(pair.left.size(), 7);
  matcher->match(gray16(pair.left, pair.width, pair.height),
                 gray16(pair.right, pair.width, pair.height),
                 {out.data(), pair.width, pair.height});
  return out;
}

struct Rates {
  double density, bad;
};
// Over the pixels that the right image sees.
Rates rates(const StereoPair& pair, const Disparities& found, int border) {
  int count = 0, valid = 0, bad = 0;
  for (int y = 0; y < pair.height; ++y)
    for (int x = border; x < pair.width; ++x) {
      const auto at = static_cast<std::size_t>(y * pair.width + x);
      ++count;
      if (found[at] < 0) continue;
      ++valid;
      bad += std::abs(found[at] / double{kDisparityScale} - pair.disparity[at]) > 1.0;
    }
  return {double(valid) / count, double(bad) / std::max(valid, 1)};
}

class MatcherModes : public testing::TestWithParam<MatcherMode> {};

TEST_P(MatcherModes, FindsTheDisparitiesOfATexturedPair) {
  const StereoPair pair = test::textured_pair(203, 117, 22, 9, 1);
  const Rates found = rates(pair, matched(pair, {.mode = GetParam(), .disparity_count = 32}), 32);
  EXPECT_GT(found.density, 0.85);
  EXPECT_LT(found.bad, 0.01);
}

TEST_P(MatcherModes, DoesNotMindGainAndOffsetBetweenTheImagers) {
  StereoPair pair = test::textured_pair(203, 117, 22, 9, 2);
  const Disparities before = matched(pair, {.mode = GetParam(), .disparity_count = 32});
  for (auto& gray : pair.right) gray = static_cast<std::uint16_t>(gray * 3 / 4 + 300);
  EXPECT_LT(rates(pair, matched(pair, {.mode = GetParam(), .disparity_count = 32}), 32).bad, 0.01);
  EXPECT_GT(rates(pair, before, 32).density, 0.85);
}

TEST_P(MatcherModes, ALeastDisparityShiftsTheRange) {
  const StereoPair pair = test::textured_pair(203, 117, 60, 45, 3);
  const MatcherOptions options{.mode = GetParam(), .disparity_min = 40, .disparity_count = 32};
  const Rates found = rates(pair, matched(pair, options), 72);
  EXPECT_GT(found.density, 0.8);
  EXPECT_LT(found.bad, 0.01);
}

TEST_P(MatcherModes, AFlatPairHasNoDisparity) {
  StereoPair pair = test::textured_pair(90, 50, 5, 5, 4);
  for (auto* image : {&pair.left, &pair.right}) std::fill(image->begin(), image->end(), 1000);
  EXPECT_THAT(matched(pair, {.mode = GetParam()}), testing::Each(kNoDisparity));
}

TEST_P(MatcherModes, UnrelatedNoiseIsMostlyRejected) {
  const StereoPair a = test::textured_pair(160, 100, 5, 5, 5);
  StereoPair pair = a;
  pair.right = test::textured_pair(160, 100, 5, 5, 6).right;
  EXPECT_LT(rates(pair, matched(pair, {.mode = GetParam()}), 0).density, 0.05);
}

TEST_P(MatcherModes, EightBitsGiveWhatTheSameTwelveBitsGive) {
  StereoPair pair = test::textured_pair(131, 77, 12, 6, 7);
  std::vector<std::uint8_t> left8, right8;
  for (auto& gray : pair.left) left8.push_back(static_cast<std::uint8_t>(gray >> 4)), gray &= 0xFF0;
  for (auto& gray : pair.right)
    right8.push_back(static_cast<std::uint8_t>(gray >> 4)), gray &= 0xFF0;
  auto matcher = StereoMatcher::create(131, 77, {.mode = GetParam()});
  ASSERT_TRUE(matcher);
  Disparities out(pair.left.size());
  matcher->match({left8.data(), PixelFormat::kGray8, 131, 77},
                 {right8.data(), PixelFormat::kGray8, 131, 77}, {out.data(), 131, 77});
  EXPECT_EQ(out, matched(pair, {.mode = GetParam()}));
}

TEST_P(MatcherModes, TheSameMatcherGivesTheSameBytesAgain) {
  const StereoPair pair = test::textured_pair(131, 77, 12, 6, 8);
  auto matcher = StereoMatcher::create(131, 77, {.mode = GetParam()});
  ASSERT_TRUE(matcher);
  Disparities first(pair.left.size()), second(pair.left.size());
  for (auto* out : {&first, &second}) {
    const StereoPair other = test::textured_pair(131, 77, 20, 2, 9);
    matcher->match(gray16(other.left, 131, 77), gray16(other.right, 131, 77),
                   {out->data(), 131, 77});
    matcher->match(gray16(pair.left, 131, 77), gray16(pair.right, 131, 77), {out->data(), 131, 77});
  }
  EXPECT_EQ(first, second);
}

TEST_P(MatcherModes, RegionsAgreeWithTheWholeImageAndLeaveTheRestAlone) {
  const StereoPair pair = test::textured_pair(203, 117, 22, 9, 10);
  const MatcherOptions options{.mode = GetParam(), .disparity_count = 32};
  const Disparities whole = matched(pair, options);
  auto matcher = StereoMatcher::create(203, 117, options);
  ASSERT_TRUE(matcher);
  Disparities out(pair.left.size(), 12345);
  const PixelRect region{60, 30, 150, 90};
  matcher->match_regions(gray16(pair.left, 203, 117), gray16(pair.right, 203, 117), {&region, 1},
                         {out.data(), 203, 117});
  int differing = 0, outside_touched = 0;
  for (int y = 0; y < 117; ++y)
    for (int x = 0; x < 203; ++x) {
      const auto at = static_cast<std::size_t>(y * 203 + x);
      const bool inside = x >= region.x0 && x < region.x1 && y >= region.y0 && y < region.y1;
      if (inside)
        differing += std::abs(out[at] - whole[at]) > kDisparityScale / 2;
      else
        outside_touched += out[at] != 12345;
    }
  EXPECT_EQ(outside_touched, 0);
  EXPECT_LT(differing, 60 * 90 / 20);
}

INSTANTIATE_TEST_SUITE_P(Modes, MatcherModes,
                         testing::Values(MatcherMode::kFast, MatcherMode::kAccurate),
                         [](const auto& mode_info) {
                           return mode_info.param == MatcherMode::kFast ? "fast" : "accurate";
                         });

// Odd sizes, ranges and contents: this processor's kernels must give the scalar's bytes (and, under
// the address sanitizer, nothing may be read or written out of range).
class MatcherSizes : public testing::TestWithParam<int> {};

TEST_P(MatcherSizes, EveryKernelSetGivesTheSameBytes) {
  std::mt19937 random(static_cast<unsigned>(GetParam()));
  const auto between = [&](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
  };
  const int width = between(1, 140), height = between(1, 120);
  const StereoPair pair = test::textured_pair(width, height, between(0, 40), between(0, 20),
                                              static_cast<unsigned>(GetParam()));
  MatcherOptions options;
  options.mode = between(0, 1) == 0 ? MatcherMode::kFast : MatcherMode::kAccurate;
  options.disparity_min = between(0, 2) == 0 ? between(0, 255) : 0;
  options.disparity_count = 32 * between(1, 8);
  options.uniqueness_percent = between(0, 30);
  options.left_right_difference = between(-1, 3);
  options.speckle_pixels = between(0, 50);
  options.texture_min = between(0, 200);
  options.median = between(0, 1) == 0;
  std::vector<PixelRect> regions;
  for (int k = between(0, 3); k > 0; --k) {
    const int x0 = between(-5, width), y0 = between(-5, height);
    regions.push_back({x0, y0, x0 + between(0, 60), y0 + between(0, 60)});
  }
  if (regions.empty()) regions.push_back({0, 0, width, height});
  Disparities out[2];
  for (int k = 0; k < 2; ++k) {
    out[k].assign(pair.left.size(), 99);
    auto matcher = StereoMatcher::create(
        width, height, options,
        k == 0 ? stereo_kernels::scalar_kernels() : stereo_kernels::best_kernels());
    ASSERT_TRUE(matcher);
    matcher->match_regions(gray16(pair.left, width, height), gray16(pair.right, width, height),
                           regions, {out[k].data(), width, height});
  }
  EXPECT_EQ(out[0], out[1]) << width << " x " << height << ", seed " << GetParam();
}

INSTANTIATE_TEST_SUITE_P(Seeds, MatcherSizes, testing::Range(0, test::cases(60, 8)));

TEST(Matcher, RefusesOptionsItCannotServe) {
  const auto message = [](int width, int height, const MatcherOptions& options) {
    const auto matcher = StereoMatcher::create(width, height, options);
    return matcher ? std::string("made") : matcher.error().message;
  };
  EXPECT_EQ(message(64, 48, {}), "made");
  EXPECT_THAT(message(64, 48, {.disparity_count = 40}), testing::HasSubstr("multiple of 32"));
  EXPECT_THAT(message(64, 48, {.disparity_min = -1}), testing::HasSubstr("disparity_min"));
  EXPECT_THAT(message(64, 48, {.uniqueness_percent = 100}), testing::HasSubstr("uniqueness"));
  EXPECT_THAT(message(0, 48, {}), testing::HasSubstr("0 x 48"));
  EXPECT_THAT(message(40000, 40000, {}), testing::HasSubstr("1920 x 1080"));
}

}  // namespace
}  // namespace wagonsight
