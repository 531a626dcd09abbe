#include "capture/clock_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace wagonsight {
namespace {

HostTime at(double seconds) {
  return HostTime{} + from_seconds(seconds);
}

// A device whose clock is wrong by `drift_ppm`, and a host that sees its frames late.
class Device {
 public:
  explicit Device(double drift_ppm, unsigned seed = 3) : drift_(drift_ppm * 1e-6), random_(seed) {}

  std::uint64_t ticks(double t) const {
    return 1'000'000'000 + static_cast<std::uint64_t>(t / (1 + drift_) * 60e6);
  }
  // Mostly a few milliseconds, now and then a stall.
  double lateness() {
    const double usual = std::exponential_distribution<double>(1 / 0.003)(random_);
    return std::uniform_real_distribution<double>(0, 1)(random_) < 0.02 ? usual + 0.08 : usual;
  }

 private:
  double drift_;
  std::mt19937_64 random_;
};

constexpr ClockFitOptions kKinect{60e6, std::chrono::milliseconds(20), 500};

TEST(ClockFit, FindsOffsetAndDriftUnderOneSidedLateness) {
  for (const double drift_ppm : {-120.0, 0.0, 35.0, 250.0}) {
    Device device(drift_ppm);
    ClockFit fit(kKinect);
    double worst_ms = 0;
    for (int i = 0; i < 30 * 180; ++i) {
      const double t = 5.0 + i / 30.0;
      const HostTime arrival = at(t + 0.020 + device.lateness());
      const HostTime instant = fit.observe(device.ticks(t), arrival);
      ASSERT_LE(instant, arrival);
      if (i > 30 * 20) worst_ms = std::max(worst_ms, std::abs(to_milliseconds(instant - at(t))));
    }
    EXPECT_LT(worst_ms, 0.5) << drift_ppm;
    EXPECT_NEAR(fit.drift_ppm(), drift_ppm, 5) << drift_ppm;
    EXPECT_EQ(fit.restarts(), 0U);
  }
}

TEST(ClockFit, IsWithinTwoMillisecondsFromTheFirstSeconds) {
  Device device(100);
  ClockFit fit(kKinect);
  for (int i = 0; i < 30 * 20; ++i) {
    const double t = i / 30.0;
    const HostTime instant = fit.observe(device.ticks(t), at(t + 0.020 + device.lateness()));
    if (i > 30) {
      ASSERT_LT(std::abs(to_milliseconds(instant - at(t))), 2.0) << t;
    }
  }
}

TEST(ClockFit, FollowsADriftThatChangesWithTheTemperature) {
  ClockFit fit({1e6, {}, 500});
  Device jitter(0);
  double device_s = 0;
  double worst_ms = 0;
  for (int i = 0; i < 30 * 1800; ++i) {
    const double t = i / 30.0;
    const double drift = 20e-6 + 30e-6 * t / 1800;  // 30 ppm in half an hour
    device_s += (1.0 / 30.0) / (1 + drift);
    const double true_t = t + 1.0 / 30.0;
    const HostTime instant =
        fit.observe(static_cast<std::uint64_t>(device_s * 1e6), at(true_t + jitter.lateness()));
    if (i > 30 * 120)
      worst_ms = std::max(worst_ms, std::abs(to_milliseconds(instant - at(true_t))));
  }
  EXPECT_LT(worst_ms, 0.6);
}

TEST(ClockFit, StartsAgainWhenTheDeviceDoes) {
  ClockFit fit(kKinect);
  Device device(50);
  for (int i = 0; i < 300; ++i) fit.observe(device.ticks(i / 30.0), at(i / 30.0 + 0.02));
  // Unplugged and back: its counter starts at zero.
  for (int i = 0; i < 300; ++i) {
    const double t = 20 + i / 30.0;
    const HostTime instant = fit.observe(static_cast<std::uint64_t>(i * 2'000'000), at(t + 0.020));
    EXPECT_NEAR(to_milliseconds(instant - at(t)), 0, 1.0);
  }
  EXPECT_EQ(fit.restarts(), 1U);
}

TEST(ClockFit, StartsAgainAfterAStepThatNoDriftExplains) {
  for (const double step_s : {+3.0, -3.0}) {  // of the device's clock, counting on
    ClockFit fit(kKinect);
    Device device(0);
    HostTime instant{};
    for (int i = 0; i < 1200; ++i) {
      const double t = 10 + i / 30.0;
      instant = fit.observe(device.ticks(t + (i >= 600 ? step_s : 0)), at(t + 0.020));
    }
    EXPECT_EQ(fit.restarts(), 1U) << step_s;
    EXPECT_NEAR(to_milliseconds(instant - at(10 + 1199 / 30.0)), 0, 1.0) << step_s;
  }
}

TEST(ClockFit, KeepsItsLineThroughAStallOfTheHost) {
  ClockFit fit(kKinect);
  Device device(30);
  for (int i = 0; i < 30 * 60; ++i) {
    const double t = i / 30.0;
    // For 1.5 s nothing is read; the frames then arrive all at once.
    const double stall = t > 40 && t < 41.5 ? 41.5 - t : 0;
    const HostTime instant =
        fit.observe(device.ticks(t), at(t + 0.020 + stall + device.lateness()));
    if (t > 20) {
      ASSERT_LT(std::abs(to_milliseconds(instant - at(t))), 0.6) << t;
    }
  }
  EXPECT_EQ(fit.restarts(), 0U);
}

TEST(TickUnwrapper, CountsOnAcrossTheWrap) {
  TickUnwrapper unwrapper(32);
  std::uint64_t last = unwrapper.unwrap(0xFFFF0000U);
  for (int i = 1; i < 1'000'000; ++i) {
    const auto raw =
        static_cast<std::uint32_t>(0xFFFF0000U + 2'000'000U * static_cast<unsigned>(i));
    const std::uint64_t ticks = unwrapper.unwrap(raw);
    ASSERT_EQ(ticks - last, 2'000'000U);
    last = ticks;
  }
}

TEST(TickUnwrapper, TellsAStepBackwards) {
  TickUnwrapper unwrapper(32);
  const std::uint64_t first = unwrapper.unwrap(1000);
  EXPECT_EQ(first - unwrapper.unwrap(400), 600U);
}

}  // namespace
}  // namespace wagonsight
