#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>

#include "capture/frame_set_builder.h"
#include "kinect_bench.h"
#include "linux/clocks.h"
#include "simulate/kinect_model.h"
#include "simulate/scene.h"
#include "simulate/world.h"

// What becomes of the frames of emulated Kinects: scenes as they were rendered, and FrameSets.
namespace wagonsight::device {
namespace {

Scene walk_scene() {
  std::ifstream file(WAGONSIGHT_SOURCE_DIR "/config/scenes/walk.toml");
  std::stringstream text;
  text << file.rdbuf();
  auto scene = parse_scene(text.str(), "walk.toml");
  EXPECT_TRUE(scene) << scene.error().message;
  return *scene;
}

// A simulated Kinect's millimetres as the raw disparities of an emulated one.
class SceneFeed {
 public:
  SceneFeed(const Scene& scene, std::size_t sensor)
      : scene_(scene), world_(scene_, 7), model_(scene_, sensor, 7), depth_(KinectUnit::kPixels) {}

  // `unit` tells which raw value is which depth.
  void raw_picture(const KinectUnit& unit, std::uint32_t number, std::span<std::uint16_t> raw) {
    auto known = pictures_.find(number);
    if (known == pictures_.end()) {
      if (pictures_.empty()) first_ = number;
      const auto at = from_seconds(static_cast<double>(number - first_) / 30.0);
      model_.render(world_, HostTime(at), number, depth_);
      if (nearest_.empty()) invert(unit);
      known = pictures_.emplace(number, std::vector<std::uint16_t>(depth_.size())).first;
      for (std::size_t i = 0; i < depth_.size(); ++i) known->second[i] = nearest_[depth_[i]];
      rendered_[number] = depth_;
    }
    std::copy(known->second.begin(), known->second.end(), raw.begin());
  }
  const std::vector<std::uint16_t>& millimetres(std::uint32_t number) const {
    return rendered_.at(number);
  }

 private:
  void invert(const KinectUnit& unit) {
    nearest_.assign(65'536, 2047);
    std::uint16_t raw = 0;
    for (unsigned depth = 400; depth < 9'000; ++depth) {
      while (raw < 1090 && unit.millimetres(raw) < depth) ++raw;
      nearest_[depth] = raw;
    }
  }

  Scene scene_;
  World world_;
  KinectModel model_;
  std::vector<std::uint16_t> depth_, nearest_;
  std::map<std::uint32_t, std::vector<std::uint16_t>> pictures_, rendered_;
  std::uint32_t first_ = 0;
};

TEST(KinectFrames, ShowTheSceneThatWasRendered) {
  const Scene scene = walk_scene();
  SceneFeed feed(scene, 0);
  KinectBench* bench_of_feed = nullptr;
  KinectBench bench(1, {}, [&](std::size_t, std::uint32_t number, std::span<std::uint16_t> raw) {
    feed.raw_picture(bench_of_feed->unit(0), number, raw);
  });
  bench_of_feed = &bench;
  std::uint64_t compared = 0;
  std::uint64_t off = 0;
  bench.hand_on([&](FrameSlot* slot) {
    const auto& sent = feed.millimetres(bench.frame_number(0, *slot));
    const DepthImage depth = slot->depth();
    for (std::size_t i = 0; i < sent.size(); ++i) {
      const int meant = sent[i] < 400 || sent[i] >= 9'000 ? 0 : sent[i];
      // One step of the raw value is 3 mm at 1 m and grows with the square of the distance.
      const int step = 2 + meant * (meant / 1'000) * 3 / 1'000 + meant / 300;
      ++compared;
      off += std::abs(depth.pixels[i] - meant) > step ? 1U : 0U;
    }
    bench.pool().release(slot);
  });
  bench.run(1.4);
  EXPECT_GT(compared, 25U * KinectUnit::kPixels);
  EXPECT_EQ(off, 0U);
  EXPECT_EQ(bench.log(0).wrong_pixels, 0U);
}

// Four Kinects that nobody can trigger, with every phase and drift, lateness of up to 5 ms and one
// packet in 5000 lost.
TEST(KinectFrames, MakeFrameSetsWhoseSkewIsKnownToAMillisecond) {
  KinectBench bench(4, [](std::size_t unit, KinectUnit::Options& options) {
    const std::array<double, 4> drifts{-50, 50, 20, -10};
    options.drift_ppm = drifts[unit];
    options.jitter = 5'000'000;
  });
  for (std::size_t i = 0; i < 4; ++i) bench.faults(i).lost = 1.0 / 5000;
  const std::array<double, 4> rates{30, 30, 30, 30};
  FrameSetBuilder builder(bench.pool(), rates);
  bench.hand_on([&](FrameSlot* slot) { builder.add(slot); });

  std::uint64_t sets = 0;
  std::uint64_t full = 0;
  std::vector<double> spread_ms;
  double error_ms_most = 0;
  for (int step = 0; step < 2'800; ++step) {
    bench.run(0.01);
    FrameSet set;
    while (builder.next(host_now(), set)) {
      if (step < 1'600) continue;  // the drifts are known after 10 to 14 s
      ++sets;
      double low = 1e9;
      double high = -1e9;
      std::vector<double> stated_less_true;
      for (std::size_t i = 0; i < 4; ++i) {
        const SensorFrame& frame = set.sensors[i];
        if (frame.state != FrameState::kPresent) continue;
        const auto number = bench.frame_number(i, *frame.slot);
        const double taken_ms = static_cast<double>(bench.unit(i).light_of(number)) * 1e-6;
        low = std::min(low, taken_ms);
        high = std::max(high, taken_ms);
        stated_less_true.push_back(to_milliseconds(frame.skew) - taken_ms);
      }
      full += stated_less_true.size() == 4 ? 1U : 0U;
      if (stated_less_true.size() == 4) spread_ms.push_back(high - low);
      const auto [least, most] =
          std::minmax_element(stated_less_true.begin(), stated_less_true.end());
      error_ms_most = std::max(error_ms_most, *most - *least);
    }
  }
  std::sort(spread_ms.begin(), spread_ms.end());
  std::printf(
      "FrameSets %llu, %.1f%% with all four; spread median %.1f, p99 %.1f ms; "
      "stated skew wrong by at most %.2f ms\n",
      static_cast<unsigned long long>(sets),
      100.0 * static_cast<double>(full) / static_cast<double>(sets),
      spread_ms[spread_ms.size() / 2], spread_ms[spread_ms.size() * 99 / 100], error_ms_most);
  EXPECT_GT(sets, 350U);
  EXPECT_GT(full, sets * 8 / 10);  // the lost packets damage 5% of each sensor's frames
  EXPECT_LT(error_ms_most, 1.0);
  EXPECT_LE(spread_ms.back(), 25.0);
  for (std::size_t i = 0; i < 4; ++i) {
    // Every frame of the device was used, or is counted by its cause.
    const auto& c = builder.counters(i);
    EXPECT_LE(c.received - c.used - c.damaged - c.late - c.superseded - c.overrun, 8U);
    EXPECT_EQ(c.out_of_order + c.duplicates + c.implausible, 0U);
    EXPECT_EQ(bench.log(i).wrong_pixels, 0U);
  }
}

}  // namespace
}  // namespace wagonsight::device
