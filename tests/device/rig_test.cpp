#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>

#include "capture/frame_set_builder.h"
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
  Rig()
      : pool_(64, IidcUnit::kBytes),
        stereos_(kStereos, [](std::size_t, IidcUnit::Options&, IidcOptions& sensor) {
          sensor.sensor_index = static_cast<std::uint8_t>(sensor.sensor_index + kKinects);
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

}  // namespace
}  // namespace wagonsight::device
