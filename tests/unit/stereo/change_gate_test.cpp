#include "stereo/change_gate.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <random>
#include <vector>

namespace wagonsight {
namespace {

constexpr int kWidth = 331, kHeight = 205;
using Pixels = std::vector<std::uint16_t>;

// A room with structure, and noise of `sigma` drawn anew from `seed`.
Pixels room(unsigned seed, double sigma, double gain = 1.0) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, sigma);
  Pixels pixels;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const double wall = 900 + 2 * x + ((x / 23 + y / 31) % 2 == 0 ? 350 : 0);
      pixels.push_back(static_cast<std::uint16_t>(std::max(gain * wall + noise(random), 0.0)));
    }
  return pixels;
}

void put_person(Pixels& pixels, const PixelRect& place, unsigned gray) {
  for (int y = place.y0; y < place.y1; ++y)
    for (int x = place.x0; x < place.x1; ++x)
      pixels[static_cast<std::size_t>(y * kWidth + x)] =
          static_cast<std::uint16_t>(gray + static_cast<unsigned>(x * 7 + y * 13) % 97);
}

GrayImage view(const Pixels& pixels) {
  return {pixels.data(), PixelFormat::kGray16, kWidth, kHeight};
}

bool covers(std::span<const PixelRect> regions, const PixelRect& wanted) {
  for (int y = wanted.y0; y < wanted.y1; ++y)
    for (int x = wanted.x0; x < wanted.x1; ++x) {
      bool inside = false;
      for (const PixelRect& r : regions)
        inside = inside || (x >= r.x0 && x < r.x1 && y >= r.y0 && y < r.y1);
      if (!inside) return false;
    }
  return true;
}

const PixelRect kAll{0, 0, kWidth, kHeight};

TEST(ChangeGate, TheFirstImageIsMatchedWhole) {
  ChangeGate gate(kWidth, kHeight);
  EXPECT_THAT(gate.regions(view(room(1, 12)), false, {}), testing::ElementsAre(kAll));
}

TEST(ChangeGate, NoiseIsNoChange) {
  ChangeGate gate(kWidth, kHeight);
  gate.regions(view(room(1, 12)), false, {});
  for (unsigned seed = 2; seed < 40; ++seed)
    EXPECT_TRUE(gate.regions(view(room(seed, 12)), false, {}).empty()) << seed;
}

// A tunnel's gain makes the noise several times what was stated; a person still is a change.
TEST(ChangeGate, NoiseIsWhatHalfOfTheImageShows) {
  ChangeGate gate(kWidth, kHeight);
  gate.regions(view(room(1, 40)), false, {});
  for (unsigned seed = 2; seed < 20; ++seed)
    EXPECT_TRUE(gate.regions(view(room(seed, 40)), false, {}).empty()) << seed;
  const PixelRect place{120, 60, 170, 150};
  Pixels with = room(30, 40);
  put_person(with, place, 500);
  EXPECT_TRUE(covers(gate.regions(view(with), false, {}), place));
}

TEST(ChangeGate, TheBrightnessOfTheWholeImageIsNoChange) {
  ChangeGate gate(kWidth, kHeight);
  gate.regions(view(room(1, 12)), false, {});
  for (const double gain : {0.25, 0.5, 0.8, 1.3, 2.0})
    EXPECT_TRUE(gate.regions(view(room(9, 12, gain)), false, {}).empty()) << gain;
}

TEST(ChangeGate, APersonIsMatchedWithAMarginAndLeavingTooButNotStanding) {
  ChangeGate gate(kWidth, kHeight);
  gate.regions(view(room(1, 12)), false, {});
  const PixelRect place{120, 60, 170, 150};
  Pixels with = room(2, 12);
  put_person(with, place, 700);
  const auto entering = gate.regions(view(with), false, {});
  EXPECT_TRUE(covers(entering, {place.x0 - 8, place.y0 - 8, place.x1 + 8, place.y1 + 8}));
  EXPECT_LT(entering.size(), 3U);
  EXPECT_NEAR(gate.changed_share(), 50.0 * 90 / (kWidth * kHeight), 0.06);
  EXPECT_TRUE(gate.regions(view(with), false, {}).empty());  // matched, and the same since
  EXPECT_TRUE(covers(gate.regions(view(room(3, 12)), false, {}), place));  // gone again
}

TEST(ChangeGate, FeedbackAndWholeAreAlwaysMatched) {
  ChangeGate gate(kWidth, kHeight);
  gate.regions(view(room(1, 12)), false, {});
  const PixelRect track{200, 100, 230, 160};
  EXPECT_TRUE(covers(gate.regions(view(room(2, 12)), false, {&track, 1}), track));
  EXPECT_THAT(gate.regions(view(room(3, 12)), true, {}), testing::ElementsAre(kAll));
}

HostTime at(double seconds) {
  return HostTime(from_seconds(seconds));
}

// The slow rhythm: a strip at a time, everything once in its time, nothing that was matched lately.
TEST(ChangeGate, WhatNeverChangesIsMatchedByStripsInTurns) {
  ChangeGate gate(kWidth, kHeight, {.whole_every_s = 4.0, .whole_phase_s = 0.5});
  gate.regions(view(room(1, 12)), false, {}, {}, at(0));
  std::vector<double> latest(static_cast<std::size_t>(kWidth * kHeight), 0.0);
  double longest = 0, most = 0;
  for (int k = 1; k < 120; ++k) {
    const double now = 0.1 * k;
    double matched = 0;
    for (const PixelRect& r : gate.regions(view(room(2, 12)), false, {}, {}, at(now))) {
      matched += static_cast<double>((r.x1 - r.x0) * (r.y1 - r.y0));
      for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x) {
          double& before = latest[static_cast<std::size_t>(y * kWidth + x)];
          longest = std::max(longest, now - before);
          before = now;
        }
    }
    most = std::max(most, matched / (kWidth * kHeight));
  }
  EXPECT_LT(most, 0.35);
  EXPECT_LT(longest, 4.15);
  EXPECT_GE(*std::min_element(latest.begin(), latest.end()), 11.9 - 4.15);
}

TEST(ChangeGate, AfterAGapEverythingIsDue) {
  ChangeGate gate(kWidth, kHeight, {.whole_every_s = 2.0});
  gate.regions(view(room(1, 12)), false, {}, {}, at(0));
  EXPECT_THAT(gate.regions(view(room(2, 12)), false, {}, {}, at(2.5)), testing::ElementsAre(kAll));
}

// Those who sit still are looked at in turns: each at its rhythm, never all at once.
TEST(ChangeGate, FeedbackTakesTurns) {
  ChangeGate gate(kWidth, kHeight, {.feedback_every_s = 0.5});
  gate.regions(view(room(1, 12)), false, {}, {}, at(0));
  std::vector<PixelRect> people;
  for (int k = 0; k < 4; ++k) people.push_back({20 + 80 * k, 40, 60 + 80 * k, 150});
  std::vector<int> looks(people.size(), 0);
  for (int k = 0; k < 28; ++k) {  // two seconds
    double matched = 0;
    const auto regions = gate.regions(view(room(2, 12)), false, people, {}, at(1.0 + 0.0714 * k));
    for (const PixelRect& r : regions)
      matched += static_cast<double>((r.x1 - r.x0) * (r.y1 - r.y0));
    EXPECT_LT(matched / (kWidth * kHeight), 0.5) << k;
    for (std::size_t p = 0; p < people.size(); ++p) looks[p] += covers(regions, people[p]);
  }
  EXPECT_THAT(looks, testing::Each(testing::AllOf(testing::Ge(3), testing::Le(5))));
}

TEST(ChangeGate, AlmostEverythingChangedIsTheWholeImage) {
  ChangeGate gate(kWidth, kHeight);
  gate.regions(view(room(1, 12)), false, {});
  Pixels other = room(2, 12);
  put_person(other, {0, 0, kWidth, kHeight * 3 / 4}, 300);
  EXPECT_THAT(gate.regions(view(other), false, {}), testing::ElementsAre(kAll));
}

TEST(ChangeGate, RegionsAreDisjointAndInsideForAnySize) {
  std::mt19937 random(3);
  for (int round = 0; round < 60; ++round) {
    const auto between = [&](int low, int high) {
      return std::uniform_int_distribution<int>(low, high)(random);
    };
    const int width = between(1, 200), height = between(1, 150);
    ChangeGate gate(width, height, {.whole_share = 2.0});
    std::vector<std::uint8_t> image(static_cast<std::size_t>(width * height), 100);
    gate.regions({image.data(), PixelFormat::kGray8, width, height}, false, {});
    for (int k = between(0, 5); k > 0; --k)
      image[static_cast<std::size_t>(between(0, width * height - 1))] = 255;
    std::vector<PixelRect> feedback;
    for (int k = between(0, 4); k > 0; --k) {
      const int x = between(-20, width + 20), y = between(-20, height + 20);
      feedback.push_back({x, y, x + between(0, 30), y + between(0, 30)});
    }
    const auto regions =
        gate.regions({image.data(), PixelFormat::kGray8, width, height}, false, feedback);
    std::vector<int> covered(image.size());
    for (const PixelRect& r : regions) {
      ASSERT_TRUE(r.x0 >= 0 && r.y0 >= 0 && r.x1 <= width && r.y1 <= height && !r.empty());
      for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x) ++covered[static_cast<std::size_t>(y * width + x)];
    }
    EXPECT_THAT(covered, testing::Each(testing::Le(1)));
  }
}

}  // namespace
}  // namespace wagonsight
