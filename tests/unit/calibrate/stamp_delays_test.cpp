#include "calibrate/stamp_delays.h"

#include <gmock/gmock.h>

#include <cmath>
#include <random>

namespace wagonsight {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

struct Watcher {
  std::string name;
  double rate_hz = 30;
  double phase_s = 0;
  double delay_s = 0;
  Vector3d offset = Vector3d::Zero();
  double noise_m = 0.006;
  double from_s = 0, until_s = 15;
  double wrong_share = 0;  // of samples that are of something else
};

Vector3d waved(double t) {
  return {3 + 0.5 * std::sin(4.2 * t), 1.3 + 0.35 * std::sin(3.1 * t + 1),
          1.4 + 0.25 * std::sin(5.7 * t + 2)};
}
Vector3d held(double) {
  return {3, 1.3, 1.4};
}

std::vector<TargetTrack> tracks_of(const std::vector<Watcher>& watchers, unsigned seed,
                                   Vector3d (*way)(double) = waved) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<TargetTrack> tracks;
  for (const Watcher& watcher : watchers) {
    TargetTrack& track = tracks.emplace_back();
    track.name = watcher.name;
    for (double t = watcher.from_s + watcher.phase_s; t < watcher.until_s;
         t += 1 / watcher.rate_hz) {
      Vector3d p_W = way(t) + watcher.offset;
      for (int k = 0; k < 3; ++k) p_W[k] += watcher.noise_m * normal(random);
      if (uniform(random) < watcher.wrong_share) p_W.x() += 0.8;
      track.samples.push_back({t + watcher.delay_s, p_W});
    }
  }
  return tracks;
}

TEST(StampDelays, AreFoundBesideOffsetsNoiseAndWrongSightings) {
  const std::vector<Watcher> watchers{
      {"k0", 30, 0.000, 0.016, {0.012, 0, 0}, 0.008, 0, 15, 0.02},
      {"k1", 30, 0.011, 0.016, {0, -0.02, 0.004}, 0.008, 0, 10},
      {"s0", 14, 0.005, 0.032, {-0.015, 0.01, 0}, 0.012, 0, 15, 0.02},
      {"s1", 14, 0.040, 0.045, {0, 0, 0.02}, 0.012, 5, 15}};
  for (const unsigned seed : {1U, 2U, 3U}) {
    const auto found = estimate_stamp_delays(tracks_of(watchers, seed));
    ASSERT_TRUE(found) << found.error().message;
    const double shift = (*found)[0].delay_s - watchers[0].delay_s;
    EXPECT_LE(std::min((*found)[0].delay_s, (*found)[1].delay_s), 0);  // the earliest is zero
    for (std::size_t i = 0; i < watchers.size(); ++i) {
      const SensorDelay& one = (*found)[i];
      EXPECT_NEAR(one.delay_s - shift, watchers[i].delay_s, 0.0012) << watchers[i].name;
      EXPECT_GT(one.sigma_s, 1e-5) << watchers[i].name;
      EXPECT_LT(one.sigma_s, 1e-3) << watchers[i].name;
      EXPECT_NEAR(one.rms_m, watchers[i].noise_m, 0.4 * watchers[i].noise_m) << watchers[i].name;
      EXPECT_LT(
          (one.offset_W - (*found)[0].offset_W - watchers[i].offset + watchers[0].offset).norm(),
          0.006)
          << watchers[i].name;
    }
  }
}

// What is said of the error is about what the errors are.
TEST(StampDelays, SigmaIsThatOfTheErrors) {
  const std::vector<Watcher> watchers{{"k0", 30, 0.00, 0.000, Vector3d::Zero(), 0.01, 0, 6},
                                      {"s0", 14, 0.02, 0.020, Vector3d::Zero(), 0.01, 0, 6}};
  double squares = 0, said = 0;
  constexpr unsigned kTrials = 30;
  for (unsigned seed = 1; seed <= kTrials; ++seed) {
    const auto found = estimate_stamp_delays(tracks_of(watchers, seed));
    ASSERT_TRUE(found) << found.error().message;
    const double error = (*found)[1].delay_s - (*found)[0].delay_s - 0.020;
    squares += error * error / kTrials;
    said += 2 * (*found)[1].sigma_s / kTrials;  // of two, the mean lies in the middle
  }
  EXPECT_LT(std::sqrt(squares), 2 * said);
  EXPECT_GT(std::sqrt(squares), said / 2);
}

TEST(StampDelays, AnUntiedSensorIsNamed) {
  const std::vector<Watcher> watchers{{.name = "k0", .until_s = 5},
                                      {.name = "k1", .until_s = 5},
                                      {.name = "s0", .rate_hz = 14, .from_s = 8}};
  const auto found = estimate_stamp_delays(tracks_of(watchers, 1));
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().message,
              HasSubstr("s0 never saw the moving target together with k0, k1"));
}

TEST(StampDelays, ATargetThatIsHeldStillTellsNothing) {
  const std::vector<Watcher> watchers{{.name = "k0", .noise_m = 0.001},
                                      {.name = "k1", .noise_m = 0.001}};
  const auto found = estimate_stamp_delays(tracks_of(watchers, 1, held));
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().message, HasSubstr("did not move enough before k0, k1"));
}

TEST(StampDelays, WhoSawNothingIsNamed) {
  auto tracks = tracks_of({{.name = "k0"}, {.name = "k1"}, {.name = "k2"}}, 1);
  tracks[1].samples.clear();
  const auto found = estimate_stamp_delays(tracks);
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().message, HasSubstr("hardly seen by k1"));
}

TEST(StampDelays, OneSensorAloneIsRefused) {
  const auto found = estimate_stamp_delays(tracks_of({{.name = "k0"}}, 1));
  ASSERT_FALSE(found);
  EXPECT_THAT(found.error().message, HasSubstr("one sensor alone"));
}

}  // namespace
}  // namespace wagonsight
