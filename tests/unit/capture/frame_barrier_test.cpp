#include "capture/frame_barrier.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <vector>

#include "grouping_bench.h"

namespace wagonsight {
namespace {

using std::chrono::milliseconds;

constexpr double kTimer_s = 0.052632;

FrameSetOptions barrier(bool tick_when_silent = false) {
  return {.tick_when_silent = tick_when_silent, .grouping = Grouping::kBarrier};
}

double spread_ms(const Outcome& outcome) {
  const auto [first, last] = std::minmax_element(outcome.skews.begin(), outcome.skews.end());
  return to_milliseconds(*last - *first);
}

// What the paper's threads do, said once more: each sleeps until the signal, takes the next image
// that arrives, and the last one gives the next signal, not before the timer.
std::vector<std::vector<Sent>> by_threads(const std::vector<Sent>& sent, std::size_t sensor_count) {
  std::vector<std::vector<Sent>> sets;
  std::vector<HostTime> taken(sensor_count);
  HostTime signal = sent[0].arrival;
  while (true) {
    std::vector<Sent> images;
    for (std::size_t i = 0; i < sensor_count; ++i) {
      const auto image = std::find_if(sent.begin(), sent.end(), [&](const Sent& frame) {
        return frame.sensor_index == i && frame.arrival >= signal && frame.arrival > taken[i];
      });
      if (image != sent.end()) images.push_back(*image);
    }
    if (images.size() < sensor_count) return sets;
    HostTime opened{};
    for (const Sent& image : images) {
      opened = std::max(opened, image.arrival);
      taken[image.sensor_index] = image.arrival;
    }
    signal = std::max(signal + from_seconds(kTimer_s), opened);
    sets.push_back(std::move(images));
  }
}

RC_GTEST_PROP(FrameBarrier, TakesWhatTheThreadsWouldTake, ()) {
  const auto count = *rc::gen::inRange<std::size_t>(1, 7);
  std::vector<Device> devices(count);
  std::vector<double> rates;
  for (Device& d : devices) {
    d.rate_hz = *rc::gen::element(30, 25, 14);
    d.phase_ms = *rc::gen::inRange(0, 70'000) * 1e-3;
    d.drift_ppm = *rc::gen::inRange(-100, 101);
    d.latency_ms = *rc::gen::inRange(5, 30);
    d.latency_jitter_ms = *rc::gen::inRange(0, 8);
    rates.push_back(d.rate_hz);
  }
  const auto sent = play(devices, 6, *rc::gen::arbitrary<unsigned>());
  const auto expected = by_threads(sent, count);
  GroupingBench bench(rates, barrier());
  bench.run(sent);
  // At the end of the recording the barrier waits for nobody any more.
  RC_ASSERT(bench.outcomes().size() >= expected.size());
  RC_ASSERT(bench.outcomes().size() <= expected.size() + 2);
  RC_ASSERT(expected.size() > 50U);
  for (std::size_t k = 0; k < expected.size(); ++k) {
    const Outcome& outcome = bench.outcomes()[k];
    HostTime last{};
    for (std::size_t i = 0; i < count; ++i) {
      RC_ASSERT(outcome.states[i] == FrameState::kPresent);
      RC_ASSERT(outcome.instant + outcome.skews[i] == expected[k][i].instant);
      last = std::max(last, expected[k][i].arrival);
    }
    RC_ASSERT(outcome.handed_out == last);  // at once
    const auto [first_skew, last_skew] =
        std::minmax_element(outcome.skews.begin(), outcome.skews.end());
    RC_ASSERT(abs(*first_skew + *last_skew) <= Duration(1));  // the instant is in the middle
  }
}

// The paper's 19 Hz of four Kinects: a third of what they send is thrown away.
TEST(FrameBarrier, RunsAtTheTimersRate) {
  GroupingBench bench({30, 30, 30, 30}, barrier());
  bench.run(play({{}, {.phase_ms = 5}, {.phase_ms = 14}, {.phase_ms = 27}}, 60));
  EXPECT_NEAR(static_cast<double>(bench.outcomes().size()), 19 * 60, 3);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(bench.count(i, FrameState::kPresent), bench.outcomes().size());
    const auto& c = bench.grouping().counters(i);
    EXPECT_EQ(c.received, c.used + c.superseded);
    EXPECT_NEAR(static_cast<double>(c.superseded), 11 * 60, 4);
  }
  // Nothing cuts the phases at their widest gap (13 ms here, which leaves 20).
  double widest = 0;
  for (const Outcome& o : bench.outcomes()) widest = std::max(widest, spread_ms(o));
  EXPECT_GT(widest, 27);
  EXPECT_LT(widest, 33.4);
}

TEST(FrameBarrier, WaitsForTheSlowest) {
  GroupingBench bench({30, 10}, barrier());
  bench.run(play({{}, {.rate_hz = 10, .phase_ms = 5}}, 20));
  EXPECT_NEAR(static_cast<double>(bench.outcomes().size()), 200, 3);
  EXPECT_GE(bench.count(1, FrameState::kPresent), 199U);
}

// One image is on its way for a quarter of a second: its set is handed out without it, it is too
// late when it comes, and the next sets are whole again.
TEST(FrameBarrier, HandsOutWithoutTheLateImage) {
  auto sent = play({{}, {.phase_ms = 2}}, 10);
  std::size_t delayed = 0;
  for (Sent& frame : sent) {
    if (frame.sensor_index != 1 || frame.instant < at(5) || frame.instant > at(5.2)) continue;
    frame.arrival = frame.instant + milliseconds(250);
    ++delayed;
  }
  sort_by_arrival(sent);
  GroupingBench bench({30, 30}, barrier());
  for (const Sent& frame : sent) bench.deliver(frame);
  EXPECT_EQ(delayed, 6U);
  const std::size_t late = bench.count(1, FrameState::kLate);
  EXPECT_GE(late, 2U);
  EXPECT_LE(late, 3U);  // 250 ms of sets that waited for 93 ms each
  EXPECT_EQ(bench.count(1, FrameState::kLate) + bench.count(1, FrameState::kPresent),
            bench.outcomes().size());
  EXPECT_EQ(bench.count(0, FrameState::kPresent), bench.outcomes().size());
  EXPECT_EQ(bench.outcomes().back().states[1], FrameState::kPresent);
  bench.finish();
}

// In the paper the barrier would wait for ever.
TEST(FrameBarrier, IsNotHungByALostSensor) {
  auto sent = play({{}, {.phase_ms = 10, .until_s = 5}}, 20);
  const auto back = play({{.from_s = 100}, {.phase_ms = 10, .from_s = 12}}, 20);
  sent.insert(sent.end(), back.begin(), back.end());
  sort_by_arrival(sent);
  GroupingBench bench({30, 30}, barrier());
  for (const Sent& frame : sent) bench.deliver(frame);
  HostTime last = at(0);
  std::size_t sets_while_lost = 0;
  for (const Outcome& o : bench.outcomes()) {
    // A period of 33 ms and latency_max; then the turn until a frame calls next().
    EXPECT_LE(o.handed_out - last, milliseconds(33 + 60 + 34));
    last = o.handed_out;
    EXPECT_EQ(o.states[0], FrameState::kPresent);
    const double s = to_seconds(o.handed_out.time_since_epoch());
    if (s > 6.3 && s < 12) {
      EXPECT_EQ(o.states[1], FrameState::kLost) << s;
      ++sets_while_lost;
    } else if (s > 5.2 && s < 5.9) {
      EXPECT_EQ(o.states[1], FrameState::kLate) << s;
    } else if (s < 5 || s > 12.2) {
      EXPECT_EQ(o.states[1], FrameState::kPresent) << s;
    }
  }
  EXPECT_NEAR(static_cast<double>(sets_while_lost), 19 * 5.7, 3);  // nobody waits for it any more
  EXPECT_GT(last, at(19.9));
  bench.finish();
}

TEST(FrameBarrier, WaitsForASensorThatNeverCameOnlyAtFirst) {
  GroupingBench bench({30, 30}, barrier());
  bench.run(play({{}}, 10));
  EXPECT_LE(bench.count(1, FrameState::kLate), 12U);
  EXPECT_GE(bench.count(1, FrameState::kLost), 19U * 9 - 5);
  EXPECT_EQ(bench.count(0, FrameState::kPresent), bench.outcomes().size());
}

TEST(FrameBarrier, CountsWhatItDropsByCause) {
  GroupingBench bench({30, 30}, barrier());
  bench.deliver({0, at(1.000), at(1.020)});  // the signal
  bench.deliver({1, at(1.001), at(1.021)});
  bench.deliver({1, at(1.001), at(1.022)});  // again
  bench.deliver({1, at(0.970), at(1.023)});  // older
  bench.deliver({1, at(9.000), at(1.024)});  // from the future
  bench.deliver({0, at(1.033), at(1.053)});  // between two signals
  bench.deliver({1, at(1.034), at(1.054)});
  bench.deliver({0, at(1.067), at(1.087)});
  bench.deliver({1, at(1.068), at(1.088), true});
  bench.finish();
  const auto& counters = bench.grouping().counters(1);
  EXPECT_EQ(counters.received, 6U);
  EXPECT_EQ(counters.used, 1U);
  EXPECT_EQ(counters.duplicates, 1U);
  EXPECT_EQ(counters.out_of_order, 1U);
  EXPECT_EQ(counters.implausible, 1U);
  EXPECT_EQ(counters.superseded, 1U);
  EXPECT_EQ(counters.damaged, 1U);
  ASSERT_EQ(bench.outcomes().size(), 2U);
  EXPECT_EQ(bench.outcomes()[0].states[1], FrameState::kPresent);
  EXPECT_EQ(bench.outcomes()[1].states[1], FrameState::kDamaged);
  EXPECT_EQ(bench.outcomes()[1].states[0], FrameState::kPresent);
}

// An image that comes after its set was handed out and before the next signal.
TEST(FrameBarrier, CountsALateImage) {
  FrameSetOptions options = barrier();
  options.barrier_timer = milliseconds(200);
  GroupingBench bench({30, 30}, options);
  bench.deliver({0, at(1.000), at(1.020)});
  bench.advance(at(1.120));  // the longest wait is over
  ASSERT_EQ(bench.outcomes().size(), 1U);
  EXPECT_EQ(bench.outcomes()[0].states[1], FrameState::kLate);
  bench.deliver({1, at(1.001), at(1.130)});
  bench.deliver({1, at(1.034), at(1.140)});
  bench.deliver({0, at(1.233), at(1.253)});
  bench.deliver({1, at(1.234), at(1.254)});
  ASSERT_EQ(bench.outcomes().size(), 2U);
  EXPECT_EQ(bench.outcomes()[1].states[1], FrameState::kPresent);
  EXPECT_EQ(bench.grouping().counters(1).late, 1U);
  EXPECT_EQ(bench.grouping().counters(1).superseded, 1U);
  bench.finish();
}

TEST(FrameBarrier, TicksOnInSilenceWhenAsked) {
  for (const bool tick : {false, true}) {
    GroupingBench bench({30, 30}, barrier(tick));
    for (const Sent& frame : play({{}, {.phase_ms = 3}}, 2)) bench.deliver(frame);
    const std::size_t before = bench.outcomes().size();
    for (int ms = 2030; ms <= 5000; ms += 10) bench.advance(at(ms / 1e3));
    const std::size_t empty = bench.outcomes().size() - before;
    if (tick) {
      // A set each 93 ms while they may still come, then each 60.
      EXPECT_NEAR(static_cast<double>(empty), 1 / 0.093 + 2 / 0.06, 6);
      EXPECT_EQ(bench.outcomes().back().states,
                (std::vector<FrameState>{FrameState::kLost, FrameState::kLost}));
      EXPECT_GT(bench.outcomes().back().instant, at(4.8));
    } else {
      EXPECT_EQ(empty, 0U);
    }
    // Both are back. The first is not kept waiting for one that was lost; then they are together.
    bench.deliver({0, at(5.01), at(5.03)});
    bench.deliver({1, at(5.02), at(5.04)});
    bench.deliver({0, at(5.08), at(5.10)});
    bench.deliver({1, at(5.09), at(5.11)});
    bench.finish();
    EXPECT_EQ(bench.outcomes().back().states,
              (std::vector<FrameState>{FrameState::kPresent, FrameState::kPresent}));
  }
}

}  // namespace
}  // namespace wagonsight
