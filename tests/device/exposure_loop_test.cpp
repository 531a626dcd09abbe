#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <memory>
#include <mutex>
#include <vector>

#include "capture/frame_grouping.h"
#include "iidc_bench.h"
#include "linux/clocks.h"
#include "pipeline/pipeline.h"
#include "simulate/room.h"
#include "simulate/scene.h"

// The daemon's loop around one camera: its driver and libdc1394, the grouping, the pipeline, and
// what the pipeline's exposure law asks for back to the driver. The picture is as bright as the
// light, the shutter and the gain make it.
namespace wagonsight::device {
namespace {

constexpr double kWanted = 0.35;  // ExposureTarget's mean, of full scale

// A wall of random speckles, seen by the right imager 12 pixels further left.
void paint_wall(double gray_of_white, std::span<std::uint16_t> gray) {
  constexpr std::size_t kWidth = IidcUnit::kWidth, kHeight = IidcUnit::kHeight, kDisparity = 12;
  std::array<std::uint16_t, 256> tone{};
  for (std::size_t i = 0; i < tone.size(); ++i)
    tone[i] = static_cast<std::uint16_t>(
        std::min(4095.0, gray_of_white * (0.1 + 0.9 * static_cast<double>(i) / 255)));
  for (std::size_t side = 0; side < 2; ++side)
    for (std::size_t y = 0; y < kHeight; ++y)
      for (std::size_t x = 0; x < kWidth; ++x) {
        const std::size_t u = x + side * kDisparity;
        const auto speckle = static_cast<std::uint32_t>((u / 3) * 2654435761U ^ (y / 3) * 40503U);
        gray[(side * kHeight + y) * kWidth + x] = tone[(speckle * 2246822519U) >> 24U];
      }
}

class ExposureLoop {
 public:
  struct Image {
    double light = 0;  // that fell on it
    double mean = 0;   // of what the law saw, of full scale
    bool usable = false;
    bool is_told_right = false;  // the driver told the shutter and gain that it was taken with
  };

  // `light` 1 makes white 4095 at 1 ms without gain.
  explicit ExposureLoop(double light)
      : light_(light),
        rig_(rig_of(scene())),
        bench_(1, [this](std::size_t, IidcUnit::Options& options, IidcOptions&) {
          options.feed = [this](const IidcUnit::Taken& taken, std::span<std::uint16_t> gray) {
            const double ms = static_cast<double>(taken.exposure) * 1e-6;
            paint_wall(4095 * light_ * ms * std::pow(10.0, taken.gain_db / 20), gray);
            taken_.push_back({taken, light_});
          };
        }) {
    PipelineOptions options;
    options.stereo.aligned_every_s = 0;
    auto made = Pipeline::create(rig_, {}, wagon_of(scene()), options);
    EXPECT_TRUE(made) << made.error().message;
    pipeline_ = std::move(*made);
    const double rates[] = {14};
    grouping_ = make_frame_grouping(bench_.pool(), rates, {});
    bench_.hand_on([this](FrameSlot* slot) { take(slot); });
  }

  void run(double seconds) { bench_.run(seconds); }
  // From now on, in virtual time; whole images only.
  void change_light(double light) {
    const std::lock_guard hold(VirtualTime::instance().mutex());
    light_ = light;
  }
  const std::vector<Image>& images() const { return images_; }
  std::uint64_t unusable() const { return pipeline_->stereo_report(0)->unusable; }

 private:
  struct TakenIn {
    IidcUnit::Taken taken;
    double light = 0;
  };

  static Scene scene() {
    return *parse_scene(
        "[wagon]\nlength = 6.0\nwidth = 2.7\nheight = 2.4\n"
        "[[sensor]]\nname = \"s0\"\nkind = \"stereo\"\nposition = [1.6, 0.08, 2.3]\n"
        "look_at = [3.2, 1.7, 0.4]\n",
        "exposure");
  }

  void take(FrameSlot* slot) {
    grouping_->add(slot);
    FrameSet set;
    while (grouping_->next(host_now(), set)) judge(set);
  }

  // As Tracking does.
  void judge(const FrameSet& set) {
    const FrameSlot* const slot = set.sensors[0].slot;
    if (slot == nullptr) return;
    (void)pipeline_->process(set);
    const StereoReport& report = *pipeline_->stereo_report(0);
    if (report.next.shutter_us > 0) bench_.sensor(0).set_exposure(report.next);
    const std::lock_guard hold(VirtualTime::instance().mutex());
    const IidcUnit::Sent* const sent = bench_.unit(0).frame_of_ticks(slot->device_ticks);
    ASSERT_NE(sent, nullptr);
    const auto found = std::find_if(taken_.begin(), taken_.end(), [&](const TakenIn& one) {
      return one.taken.number == sent->number;
    });
    ASSERT_NE(found, taken_.end());
    const bool is_told_right =
        std::abs(static_cast<double>(slot->exposure.shutter_us) -
                 static_cast<double>(found->taken.exposure) * 1e-3) < 0.01 &&
        std::abs(static_cast<double>(slot->exposure.gain_db) - found->taken.gain_db) < 1e-3;
    images_.push_back({found->light, report.seen.mean, report.usable, is_told_right});
    taken_.erase(taken_.begin(), found);
  }

  double light_;
  Rig rig_;
  std::deque<TakenIn> taken_;
  std::vector<Image> images_;
  std::unique_ptr<Pipeline> pipeline_;
  std::unique_ptr<FrameGrouping> grouping_;
  IidcBench bench_;
};

// After a step of the light: how many images, and of them unusable ones, until it is right for
// good.
struct Settling {
  std::size_t images = 0, unusable = 0;
};

Settling settle(ExposureLoop& loop, double light) {
  const std::size_t before = loop.images().size();
  loop.change_light(light);
  loop.run(2.5);
  std::vector<ExposureLoop::Image> after(
      loop.images().begin() + static_cast<std::ptrdiff_t>(before), loop.images().end());
  std::erase_if(after, [&](const ExposureLoop::Image& image) { return image.light != light; });
  Settling settling;
  for (std::size_t i = 0; i < after.size(); ++i) {
    // The law leaves 8% either way as it is.
    const bool is_right = std::abs(after[i].mean / kWanted - 1) < 0.1;
    if (!is_right) settling.images = i + 1;
    settling.unusable += after[i].usable ? 0U : 1U;
    EXPECT_TRUE(after[i].usable || !is_right);
    EXPECT_TRUE(after[i].is_told_right) << "image " << i << " after the step to " << light;
  }
  EXPECT_GT(after.size(), settling.images + 5);
  return settling;
}

TEST(ExposureLoop, MastersATunnelAndItsEnd) {
  constexpr double kTunnel = 0.02, kDay = 4;  // two hundred times brighter
  ExposureLoop loop(kTunnel);
  loop.run(3.0);
  ASSERT_GT(loop.images().size(), 20U);
  EXPECT_NEAR(loop.images().back().mean, kWanted, 0.1 * kWanted);
  const std::uint64_t before = loop.unusable();
  const Settling out = settle(loop, kDay);
  EXPECT_EQ(loop.unusable() - before, out.unusable);
  const Settling in = settle(loop, kTunnel);
  std::printf(
      "out of the tunnel: right after %zu images, %zu of them unusable; into it: %zu, %zu\n",
      out.images, out.unusable, in.images, in.unusable);
  EXPECT_LE(out.images, 14U);  // a second
  EXPECT_GE(out.unusable, 3U);
  EXPECT_LE(in.images, 14U);
}

}  // namespace
}  // namespace wagonsight::device
