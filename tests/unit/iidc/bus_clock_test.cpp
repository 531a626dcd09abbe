#include "iidc/bus_clock.h"

#include <gtest/gtest.h>

#include "iidc/fire_nodes.h"

namespace wagonsight {
namespace {

// The 32 bits of a cycle timer after so many ticks of 24.576 MHz.
std::uint32_t timer_of(std::uint64_t ticks) {
  const std::uint64_t cycles = ticks / 3072;
  return static_cast<std::uint32_t>((cycles / 8000 % 128) << 25U | cycles % 8000 << 12U |
                                    ticks % 3072);
}
std::uint16_t stamp_of(std::uint64_t ticks) {
  const std::uint64_t cycles = ticks / 3072;
  return static_cast<std::uint16_t>((cycles / 8000 % 8) << 13U | cycles % 8000);
}

TEST(BusClock, FollowsTheTimerOverItsEndAndTheDrift) {
  BusClock clock;
  const double drift = 40e-6;
  std::uint64_t previous = 0;
  for (int step = 0; step < 4'000; ++step) {  // 200 s, over the end of the 128
    const double host_s = 1000 + step * 0.05;
    const auto bus = static_cast<std::uint64_t>((host_s * (1 + drift) - 900) * kFireTicksPerSecond);
    clock.observe(timer_of(bus), HostTime(from_seconds(host_s)));
    // A packet of 30 ms ago.
    const auto sent =
        static_cast<std::uint64_t>(((host_s - 0.03) * (1 + drift) - 900) * kFireTicksPerSecond);
    const std::uint64_t ticks = clock.ticks_of(stamp_of(sent));
    EXPECT_GT(ticks, previous);
    previous = ticks;
    if (step < 60) continue;
    const double told_s = to_seconds(clock.to_host(ticks).time_since_epoch());
    ASSERT_LE(told_s, host_s - 0.03 + 5e-6) << step;
    ASSERT_GE(told_s, host_s - 0.03 - 130e-6) << step;  // the begin of its cycle
  }
  EXPECT_NEAR(clock.drift_ppm(), -40, 1);
}

TEST(BusClock, TakesUpATimerThatJumps) {
  BusClock clock;
  for (int step = 0; step < 300; ++step) {
    const double host_s = 50 + step * 0.05;
    const double bus_s = step < 200 ? host_s : host_s - 40.7;  // another node keeps the time now
    const auto bus = static_cast<std::uint64_t>(bus_s * kFireTicksPerSecond);
    clock.observe(timer_of(bus), HostTime(from_seconds(host_s)));
    const double told_s =
        to_seconds(clock.to_host(clock.ticks_of(stamp_of(bus))).time_since_epoch());
    ASSERT_NEAR(told_s, host_s, 200e-6) << step;
  }
}

TEST(ParseGuid, TakesSixteenDigitsOnly) {
  EXPECT_EQ(parse_guid("0x00b09d0100a00003"), 0x00b09d0100a00003U);
  EXPECT_EQ(parse_guid("00B09D0100A00003"), 0x00b09d0100a00003U);
  EXPECT_EQ(parse_guid("00b09d0100a0003"), 0U);
  EXPECT_EQ(parse_guid("00b09d0100a0000g"), 0U);
  EXPECT_EQ(parse_guid(""), 0U);
}

}  // namespace
}  // namespace wagonsight
