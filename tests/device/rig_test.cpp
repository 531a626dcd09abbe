#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>
#include <vector>

#include "capture/frame_set_builder.h"
#include "iidc/trigger_line.h"
#include "iidc_bench.h"
#include "kinect_bench.h"
#include "linux/clocks.h"

// The paper's rig in one process: four Kinects and six stereo cameras. WAGONSIGHT_DEVICE_FRAMESETS
// says how many FrameSets it is to last (10,000 nightly, 100,000 as a soak).
namespace wagonsight::device {
namespace {

constexpr std::size_t kKinects = 4, kStereos = 6;

std::size_t framesets_wanted() {
  const char* text = std::getenv("WAGONSIGHT_DEVICE_FRAMESETS");
  return text == nullptr ? 150 : static_cast<std::size_t>(std::atol(text));
}

class Rig {
 public:
  explicit Rig(IidcTrigger trigger = IidcTrigger::kFree)
      : pool_(64, IidcUnit::kBytes),
        stereos_(kStereos, [trigger](std::size_t, IidcUnit::Options&, IidcOptions& sensor) {
          sensor.sensor_index = static_cast<std::uint8_t>(sensor.sensor_index + kKinects);
          sensor.trigger = trigger;
        }) {
    const auto take = [this](DeviceBench& bench) {
      return [this, &bench](FrameSlot* slot) {
        // The benches have pools of their own; a FrameSet has one.
        if (FrameSlot* const own = pool_.acquire()) {
          const auto bytes = own->bytes;
          *own = *slot;
          own->bytes = bytes;
          builder_.add(own);
        } else {
          ++not_taken_;
        }
        bench.pool().release(slot);
      };
    };
    kinects_.hand_on(take(kinects_));
    stereos_.hand_on(take(stereos_));
  }

  // Runs and hands each FrameSet to `visit`.
  template <class F>
  void run(double seconds, F visit) {
    const auto steps = static_cast<int>(seconds / 0.005);
    for (int step = 0; step < steps; ++step) {
      kinects_.run(0.005);
      stereos_.take_frames();
      FrameSet set;
      while (builder_.next(host_now(), set)) visit(set);
    }
  }

  KinectBench& kinects() { return kinects_; }
  IidcBench& stereos() { return stereos_; }
  const FrameSetBuilder& builder() const { return builder_; }
  std::uint64_t not_taken() const { return not_taken_; }

 private:
  static constexpr std::array<double, kKinects + kStereos> kRates{30, 30, 30, 30, 14,
                                                                  14, 14, 14, 14, 14};
  static FrameSetOptions options() {
    FrameSetOptions options;
    options.latency_max = std::chrono::milliseconds(120);
    return options;
  }

  FramePool pool_;
  FrameSetBuilder builder_{pool_, kRates, options()};
  KinectBench kinects_{kKinects};
  IidcBench stereos_;
  std::uint64_t not_taken_ = 0;
};

TEST(TenSensors, RunAtFullRateWithEveryPixelAsItWasSent) {
  set_sealed_heap_rule(SealedHeapRule::kAbort);
  Rig rig;
  rig.run(2.0, [](const FrameSet&) {});
  const std::size_t wanted = framesets_wanted();
  std::uint64_t sets = 0;
  std::array<std::uint64_t, kKinects + kStereos> present{};
  rig.run(static_cast<double>(wanted) / 30.0 + 0.1, [&](const FrameSet& set) {
    ++sets;
    for (std::size_t i = 0; i < present.size(); ++i)
      present[i] += set.sensors[i].state == FrameState::kPresent ? 1U : 0U;
  });
  EXPECT_GE(sets, wanted);
  EXPECT_EQ(rig.not_taken(), 0U);
  double pixels = 0;
  for (std::size_t i = 0; i < kKinects + kStereos; ++i) {
    const bool is_kinect = i < kKinects;
    DeviceBench& bench = is_kinect ? static_cast<DeviceBench&>(rig.kinects()) : rig.stereos();
    const std::size_t unit = is_kinect ? i : i - kKinects;
    const DeviceBench::Log& log = bench.log(unit);
    const DeviceBench::Balance balance = bench.balance(unit);
    EXPECT_EQ(log.wrong_pixels + log.unknown + log.damaged, 0U) << "sensor " << i;
    EXPECT_EQ(balance.missing + balance.repeated + balance.delivered_damaged, 0U) << i;
    EXPECT_EQ(bench.thread(unit).trouble(), "") << i;
    // No frame was lost between the device and the FrameSets; a few are still on their way.
    const auto& c = rig.builder().counters(i);
    EXPECT_LE(c.received - c.used, 8U) << "late " << c.late << ", superseded " << c.superseded;
    const double rate = is_kinect ? 30.0 : 14.0;
    EXPECT_GE(static_cast<double>(present[i]), static_cast<double>(sets) * rate / 30.0 * 0.97) << i;
    pixels += static_cast<double>(log.good.size()) *
              (is_kinect ? KinectUnit::kPixels : static_cast<double>(IidcUnit::kPixels));
  }
  std::printf("%llu FrameSets, %.0f million pixels checked\n",
              static_cast<unsigned long long>(sets), pixels * 1e-6);
}

// Gives the pulses in a thread of its own, as the daemon does.
class PulseThread {
 public:
  explicit PulseThread(PulseSource& pulses) : pulses_(pulses) {
    std::atomic<bool> acts{false};
    thread_ = std::thread([this, &acts] {
      const VirtualTime::Actor actor;
      acts = true;
      const HeapSeal seal;
      while (!stop_) pulses_.poll(std::chrono::milliseconds(20));
    });
    while (!acts) std::this_thread::yield();
  }
  ~PulseThread() {
    stop_ = true;
    const VirtualTime::Absence away;
    thread_.join();
  }
  PulseThread(const PulseThread&) = delete;
  PulseThread& operator=(const PulseThread&) = delete;

 private:
  PulseSource& pulses_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

double share(std::vector<double>& values, double part) {
  std::sort(values.begin(), values.end());
  return values.empty()
             ? 1e9
             : values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

// The time between the first and the last light of one pulse, over three buses, and how far the
// light lies from the ticks, which the Kinects make.
TEST(TenSensors, AreTriggeredAtOnceAtTheKinectsMidPhase) {
  set_sealed_heap_rule(SealedHeapRule::kAbort);
  Rig rig(IidcTrigger::kSoftware);
  TriggerLineOptions options;
  for (std::uint64_t i = 0; i < kStereos; ++i) options.guids.push_back(0x00b09d0100a00000 + i);
  options.plan.lead = std::chrono::milliseconds(1);  // half the shutter
  TriggerLine line(options);
  const PulseThread thread(line);
  std::vector<double> spread_ms;
  std::vector<double> from_tick_ms;
  std::uint64_t sets = 0;
  const auto visit = [&](const FrameSet& set, bool is_judged) {
    if (set.sensors[0].state == FrameState::kPresent) line.observe(set.instant);
    if (!is_judged) return;
    ++sets;
    double low = 1e9;
    double high = -1e9;
    std::size_t count = 0;
    for (std::size_t i = kKinects; i < kKinects + kStereos; ++i) {
      if (set.sensors[i].state != FrameState::kPresent) continue;
      const double skew = to_milliseconds(set.sensors[i].skew);
      low = std::min(low, skew);
      high = std::max(high, skew);
      from_tick_ms.push_back(std::abs(skew));
      ++count;
    }
    if (count == kStereos) spread_ms.push_back(high - low);
  };
  rig.run(6.0, [&](const FrameSet& set) { visit(set, false); });
  rig.run(6.0, [&](const FrameSet& set) { visit(set, true); });
  const double rate = 30.0 * static_cast<double>(spread_ms.size()) / static_cast<double>(sets);
  const double spread = share(spread_ms, 0.99);
  const double from_tick = share(from_tick_ms, 0.99);
  std::printf(
      "six triggered cameras: %.1f Hz, p99 of the skew between them %.3f ms, p99 from the "
      "Kinects' mid-phase %.3f ms\n",
      rate, spread, from_tick);
  EXPECT_LE(spread, 1.0);
  EXPECT_LE(from_tick, 2.0);
  EXPECT_GE(rate, 9.5);  // every third tick
  EXPECT_EQ(line.counters().failed, 0U);
  EXPECT_EQ(line.counters().opened, 3U);
  for (std::size_t i = 0; i < kStereos; ++i) {
    EXPECT_EQ(rig.stereos().unit(i).triggers_missed(), 0U) << i;
    EXPECT_EQ(rig.stereos().log(i).wrong_pixels, 0U) << i;
    EXPECT_EQ(rig.stereos().balance(i).missing, 0U) << i;
  }
}

}  // namespace
}  // namespace wagonsight::device
