#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <random>
#include <vector>

#include "capture/frame_grouping.h"

// Virtual devices whose frames arrive in virtual time, and what a grouping makes of them.
namespace wagonsight {

// What a virtual device sends, and when it arrives.
struct Sent {
  std::uint8_t sensor_index = 0;
  HostTime instant{}, arrival{};
  bool damaged = false;
};

struct Device {
  double rate_hz = 30;
  double phase_ms = 0;
  double drift_ppm = 0;
  double jitter_ms = 0;  // of the instant
  double latency_ms = 20;
  double latency_jitter_ms = 0;
  double drop_rate = 0;
  double from_s = 0, until_s = 1e9;  // plugged in
};

inline HostTime at(double seconds) {
  return HostTime{} + from_seconds(seconds);
}

inline void sort_by_arrival(std::vector<Sent>& sent) {
  std::stable_sort(sent.begin(), sent.end(),
                   [](const Sent& a, const Sent& b) { return a.arrival < b.arrival; });
}

inline std::vector<Sent> play(const std::vector<Device>& devices, double seconds,
                              unsigned seed = 1) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Sent> sent;
  for (std::size_t i = 0; i < devices.size(); ++i) {
    const Device& d = devices[i];
    const double period = (1 + d.drift_ppm * 1e-6) / d.rate_hz;
    for (double t = d.phase_ms / 1e3; t < seconds; t += period) {
      const double instant = t + d.jitter_ms / 1e3 * (uniform(random) - 0.5);
      const double arrival = instant + (d.latency_ms + d.latency_jitter_ms * uniform(random)) / 1e3;
      const bool dropped = uniform(random) < d.drop_rate;
      if (dropped || t < d.from_s || t >= d.until_s) continue;
      sent.push_back({static_cast<std::uint8_t>(i), at(instant), at(arrival), false});
    }
  }
  sort_by_arrival(sent);
  return sent;
}

struct Outcome {
  HostTime instant{}, handed_out{};
  std::vector<FrameState> states;
  std::vector<Duration> skews;
  bool operator==(const Outcome&) const = default;
};

class GroupingBench {
 public:
  explicit GroupingBench(std::vector<double> rates_hz, const FrameSetOptions& options = {})
      : sensor_count_(rates_hz.size()), grouping_(make_frame_grouping(pool_, rates_hz, options)) {}

  void deliver(const Sent& frame) {
    advance(frame.arrival);
    FrameSlot* slot = pool_.acquire();
    ASSERT_NE(slot, nullptr);
    slot->sensor_index = frame.sensor_index;
    slot->instant = frame.instant;
    slot->arrival = frame.arrival;
    slot->damaged = frame.damaged;
    grouping_->add(slot);
    advance(frame.arrival);
  }
  void advance(HostTime now) {
    FrameSet set;
    while (grouping_->next(now, set)) {
      EXPECT_EQ(set.index, outcomes_.size());
      Outcome outcome{set.instant, now, {}, {}};
      for (std::size_t i = 0; i < sensor_count_; ++i) {
        const SensorFrame& frame = set.sensors[i];
        EXPECT_EQ(frame.slot != nullptr, frame.state == FrameState::kPresent);
        if (frame.slot != nullptr) {
          EXPECT_EQ(frame.slot->sensor_index, i);
          EXPECT_EQ(frame.skew, frame.slot->instant - set.instant);
        }
        outcome.states.push_back(frame.state);
        outcome.skews.push_back(frame.skew);
      }
      if (!outcomes_.empty()) {
        EXPECT_GT(outcome.instant, outcomes_.back().instant);
      }
      outcomes_.push_back(outcome);
    }
  }
  void run(const std::vector<Sent>& sent) {
    for (const Sent& frame : sent) deliver(frame);
    finish();
  }
  void finish() {
    grouping_->finish();
    advance(HostTime{});
    EXPECT_EQ(pool_.in_use(), 0U) << "every slot goes back to the pool";
  }
  std::size_t count(std::size_t sensor, FrameState state) const {
    return static_cast<std::size_t>(
        std::count_if(outcomes_.begin(), outcomes_.end(),
                      [&](const Outcome& o) { return o.states[sensor] == state; }));
  }
  const std::vector<Outcome>& outcomes() const { return outcomes_; }
  FrameGrouping& grouping() { return *grouping_; }

 private:
  std::size_t sensor_count_;
  FramePool pool_{64, 64};
  std::unique_ptr<FrameGrouping> grouping_;
  std::vector<Outcome> outcomes_;
};

}  // namespace wagonsight
