// What holds of both ways of grouping.
#include "capture/frame_grouping.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <random>
#include <vector>

#include "capture/clock_fit.h"
#include "grouping_bench.h"
#include "linux/sealed_heap.h"

namespace wagonsight {
namespace {

using std::chrono::milliseconds;

class FrameGroupings : public testing::TestWithParam<Grouping> {
 protected:
  FrameSetOptions options_{.grouping = GetParam()};
};

INSTANTIATE_TEST_SUITE_P(Of, FrameGroupings,
                         testing::Values(Grouping::kHardware, Grouping::kBarrier),
                         [](const auto& grouping) {
                           return grouping.param == Grouping::kHardware ? "Hardware" : "Barrier";
                         });

// Stamps that are late by a known delay give the very sets of stamps that are not.
TEST_P(FrameGroupings, TakeTheDelayOfTheStampsOff) {
  const std::vector<Device> devices{{.rate_hz = 30, .jitter_ms = 1, .latency_ms = 50},
                                    {.rate_hz = 30, .phase_ms = 9, .latency_ms = 50},
                                    {.rate_hz = 14, .phase_ms = 21, .latency_ms = 50}};
  const std::array<Duration, 3> delays{milliseconds(16), milliseconds(0), milliseconds(32)};
  const auto sent = play(devices, 20);
  auto stamped_late = sent;
  for (Sent& frame : stamped_late) frame.instant += delays[frame.sensor_index];
  FrameSetOptions corrects = options_;
  std::copy(delays.begin(), delays.end(), corrects.stamp_delays.begin());
  GroupingBench truth({30, 30, 14}, options_), corrected({30, 30, 14}, corrects),
      raw({30, 30, 14}, options_);
  truth.run(sent);
  corrected.run(stamped_late);
  raw.run(stamped_late);
  EXPECT_EQ(truth.outcomes(), corrected.outcomes());
  EXPECT_NE(truth.outcomes(), raw.outcomes());
}

TEST_P(FrameGroupings, DropTheOldestWhenNobodyTakesSets) {
  FramePool pool(64, 64);
  const double rates[] = {30.0};
  const auto grouping = make_frame_grouping(pool, rates, options_);
  for (int i = 0; i < 20; ++i) {
    FrameSlot* slot = pool.acquire();
    slot->instant = slot->arrival = at(i / 30.0);
    grouping->add(slot);
  }
  EXPECT_EQ(grouping->counters(0).overrun, 12U);
  EXPECT_EQ(pool.in_use(), 8U);
  FrameSet set;
  ASSERT_TRUE(grouping->next(at(1), set));
  EXPECT_EQ(set.instant, at(12 / 30.0));
}

TEST_P(FrameGroupings, GiveTheSameSetsEveryTime) {
  const auto sent = play({{.jitter_ms = 3, .latency_jitter_ms = 60, .drop_rate = 0.05},
                          {.phase_ms = 16, .drift_ppm = 80, .latency_jitter_ms = 60},
                          {.rate_hz = 12, .jitter_ms = 20, .drop_rate = 0.2}},
                         60);
  GroupingBench first({30, 30, 15}, options_), second({30, 30, 15}, options_);
  first.run(sent);
  second.run(sent);
  EXPECT_EQ(first.outcomes(), second.outcomes());
}

TEST_P(FrameGroupings, NeverAllocate) {
  if (!allocations_are_seen()) GTEST_SKIP() << "this sanitizer hides allocations";
  const auto sent = play({{.jitter_ms = 3, .latency_jitter_ms = 90, .drop_rate = 0.05},
                          {.phase_ms = 16, .latency_jitter_ms = 60, .from_s = 2, .until_s = 9},
                          {.rate_hz = 12, .drop_rate = 0.2}},
                         60);
  FramePool pool(64, 64);
  const double rates[] = {30.0, 30.0, 15.0};
  options_.tick_when_silent = true;
  const auto grouping = make_frame_grouping(pool, rates, options_);
  ClockFit fit({1e9, {}, 500});
  FrameSet set;
  const std::uint64_t before = thread_allocations();
  for (const Sent& frame : sent) {
    FrameSlot* slot = pool.acquire();
    slot->sensor_index = frame.sensor_index;
    slot->instant = frame.instant;
    slot->arrival = frame.arrival;
    fit.observe(static_cast<std::uint64_t>(frame.instant.time_since_epoch().count()),
                frame.arrival);
    grouping->add(slot);
    while (grouping->next(frame.arrival, set)) {
    }
  }
  EXPECT_EQ(thread_allocations(), before);
  EXPECT_GT(grouping->set_count(), 500U);
}

// Whatever devices do, no frame is counted twice and none disappears.
TEST_P(FrameGroupings, AccountForEveryFrameWhateverHappens) {
  std::mt19937_64 random(20);
  const auto real = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int trial = 0; trial < 60; ++trial) {
    const auto count = static_cast<std::size_t>(1 + trial % 6);
    std::vector<Device> devices(count);
    std::vector<double> rates;
    for (Device& d : devices) {
      d = {real(2, 40),  real(0, 100), real(-300, 300), real(0, 20), real(0, 80),
           real(0, 120), real(0, 0.3), real(0, 3),      real(3, 12)};
      rates.push_back(trial % 2 == 0 ? d.rate_hz : 30);
    }
    auto sent = play(devices, 10, static_cast<unsigned>(trial));
    for (Sent& frame : sent) frame.damaged = real(0, 1) < 0.03;
    options_.tick_when_silent = trial % 4 == 0;
    GroupingBench bench(rates, options_);
    bench.run(sent);
    for (std::size_t i = 0; i < count; ++i) {
      const auto& c = bench.grouping().counters(i);
      EXPECT_EQ(c.received, c.used + c.duplicates + c.out_of_order + c.implausible + c.damaged +
                                c.late + c.superseded + c.overrun)
          << "trial " << trial << " sensor " << i;
      EXPECT_EQ(c.used, bench.count(i, FrameState::kPresent));
    }
  }
}

}  // namespace
}  // namespace wagonsight
