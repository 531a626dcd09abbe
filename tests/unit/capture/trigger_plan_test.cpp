#include "capture/trigger_plan.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <random>

namespace wagonsight {
namespace {

using std::chrono::milliseconds;

HostTime at(double s) {
  return HostTime(from_seconds(s));
}

TEST(TriggerPlan, RunsAtTheCamerasPaceWithoutTicks) {
  TriggerPlan plan({milliseconds(75), {}});
  EXPECT_EQ(plan.next(at(1)), at(1));
  plan.fired(at(1));
  EXPECT_EQ(plan.next(at(1.01)), at(1.075));
  EXPECT_EQ(plan.next(at(2)), at(2));
}

// Ticks of a quartz of its own, told a tenth of a second late, with jitter, and with gaps.
RC_GTEST_PROP(TriggerPlan, MeetsTheTicksWithinAMillisecond, ()) {
  const double period = 1 / 30.0 * (1 + *rc::gen::inRange(-100, 101) * 1e-6);
  const double phase = *rc::gen::inRange(0, 33'333) * 1e-6;
  const double lead = *rc::gen::inRange(0, 9'000) * 1e-6;
  std::minstd_rand random(*rc::gen::inRange(1U, 1'000'000U));
  std::uniform_real_distribution<double> jitter(-500e-6, 500e-6);
  constexpr int kTicks = 900;
  TriggerPlan plan({milliseconds(75), from_seconds(lead)});
  HostTime last_pulse{};
  int pulses = 0;
  for (int i = 0; i < kTicks; ++i) {
    const double tick = 10 + phase + period * i;
    if (random() % 12 != 0) plan.observe(at(tick + jitter(random)));
    const HostTime now = at(tick + 0.1);
    const HostTime pulse = plan.next(now);
    RC_ASSERT(pulse >= now);
    if (pulse > now + from_seconds(period)) continue;  // not within this turn
    RC_ASSERT(pulse >= last_pulse + milliseconds(75));
    plan.fired(pulse);
    last_pulse = pulse;
    ++pulses;
    if (i < 150) continue;
    const double light = (to_seconds(pulse.time_since_epoch()) + lead - 10 - phase) / period;
    RC_ASSERT(std::abs(light - std::round(light)) * period < 1e-3);
  }
  RC_ASSERT(pulses >= kTicks * 3 / 10);  // of a third
  RC_ASSERT(std::abs(to_seconds(plan.tick_period()) / period - 1) < 1e-3);
}

TEST(TriggerPlan, FollowsACutThatMoves) {
  TriggerPlan plan({milliseconds(75), {}});
  for (int i = 0; i < 100; ++i) plan.observe(at(i / 30.0));
  for (int i = 100; i < 130; ++i) plan.observe(at(i / 30.0 + 0.012));
  const double off =
      std::remainder(to_seconds(plan.next(at(130 / 30.0)).time_since_epoch()) - 0.012, 1 / 30.0);
  EXPECT_LT(std::abs(off), 1e-3);
}

}  // namespace
}  // namespace wagonsight
