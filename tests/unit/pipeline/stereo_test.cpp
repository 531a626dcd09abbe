#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "allocation_count.h"
#include "pipeline/pipeline.h"
#include "simulate/room.h"
#include "simulate/simulation.h"
#include "support/sanitized.h"
#include "support/scene_text.h"

// Simulated stereo cameras through the whole pipeline.
namespace wagonsight {
namespace {

using testing::act_text;
using testing::door_text;
using testing::passenger_text;
using testing::sensor_text;
using testing::wagon_text;

const std::string kWagon =
    wagon_text(6.0) + door_text("north", 2.35, 3.65) +
    sensor_text("s0", "stereo", "1.6, 0.08, 2.3", "3.2, 1.7, 0.4") +
    sensor_text("s1", "stereo", "4.4, 0.08, 2.3", "2.8, 1.7, 0.4", "phase_ms = 5") +
    passenger_text("Anna", "height = 1.72") + act_text(2.2, "enter", "door = 'north'") +
    act_text(3, "walk", "to = [3.0, 1.2]");

class StereoUnit {
 public:
  explicit StereoUnit(std::string_view more = "")
      : scene_(*parse_scene(kWagon + std::string(more), "test")),
        simulation_(scene_, 5),
        rig_(rig_of(scene_)) {
    PipelineOptions options;
    options.stereo.aligned_every_s = 0.5;
    options.stereo.whole_every_s = 0.5;
    auto made = Pipeline::create(rig_, {}, wagon_of(scene_), options);
    EXPECT_TRUE(made) << made.error().message;
    pipeline_ = std::move(*made);
    for (std::size_t i = 0; i < 2; ++i) {
      bytes_[i].resize(simulation_.device(i).slot_bytes());
      slots_[i].bytes = bytes_[i];
    }
  }
  // The next frame of both cameras, as one instant; a driver obeys the exposure law.
  const PeopleFrame& step() {
    FrameSet set;
    for (std::size_t i = 0; i < 2; ++i) {
      const StereoReport* report = pipeline_->stereo_report(i);
      if (obeys && report->next.shutter_us > 0) simulation_.device(i).set_exposure(report->next);
      simulation_.device(i).next(slots_[i]);
      set.sensors[i] = {FrameState::kPresent, &slots_[i], {}};
    }
    set.instant = slots_[0].instant;
    set.sensors[1].skew = slots_[1].instant - set.instant;
    const std::size_t before = testing::allocation_count();
    const PeopleFrame& frame = pipeline_->process(set);
    allocations += testing::allocation_count() - before;
    return frame;
  }
  double time() { return to_seconds(slots_[0].instant.time_since_epoch()); }
  const StereoReport& report(std::size_t i) { return *pipeline_->stereo_report(i); }
  Simulation& simulation() { return simulation_; }
  const Pipeline& pipeline() const { return *pipeline_; }
  HostTime instant(std::size_t i) const { return slots_[i].instant; }
  Rig rig() const { return rig_; }
  const Scene& scene() const { return scene_; }

  bool obeys = true;
  std::size_t allocations = 0;

 private:
  Scene scene_;
  Simulation simulation_;
  Rig rig_;
  std::array<std::vector<std::byte>, 2> bytes_;
  std::array<FrameSlot, 2> slots_;
  std::unique_ptr<Pipeline> pipeline_;
};

TEST(PipelineStereo, FollowsAPassengerWithoutAllocating) {
  StereoUnit unit;
  int with_one = 0, after = 0, before = 0;
  double error = 0, matched = 0;
  PeopleFrame truth;
  for (int i = 0; i < test::cases(90, 30); ++i) {
    const PeopleFrame& frame = unit.step();
    if (unit.time() < 2.2) before += static_cast<int>(frame.people.size());
    if (unit.time() < 4.5) continue;
    ++after;
    matched += unit.report(0).matched_share;
    if (frame.people.size() != 1) continue;
    ++with_one;
    unit.simulation().truth_at(HostTime(from_seconds(unit.time())), truth);
    ASSERT_EQ(truth.people.size(), 1U);
    error += std::hypot(frame.people[0].position[0] - truth.people[0].position[0],
                        frame.people[0].position[1] - truth.people[0].position[1]);
  }
  EXPECT_EQ(before, 0) << "noise became people";
  EXPECT_EQ(unit.allocations, 0U);
  if (test::is_sanitized()) return;  // nobody has come in yet
  EXPECT_GT(after, 20);
  EXPECT_GE(with_one, after - 2);
  EXPECT_LT(error / with_one, 0.1);
  EXPECT_LT(matched / after, 0.8) << "nearly everything was matched, though little changed";
  EXPECT_FALSE(unit.report(0).misaligned);
  EXPECT_GT(unit.report(0).row_checks, 3);
}

TEST(PipelineStereo, TheExposureLoopBringsBackATunnelAndItsEnd) {
  StereoUnit unit("[[light]]\nat = 1\nstate = \"tunnel\"\n[[light]]\nat = 4\nstate = \"day\"\n");
  double in_tunnel = 0, outside = 0;
  while (unit.time() < test::cases(13, 6) / 2.0) {
    unit.step();
    if (unit.time() < 4) in_tunnel = unit.report(0).seen.mean;
    outside = unit.report(0).seen.mean;
  }
  EXPECT_NEAR(in_tunnel, 0.35, 0.06);
  if (test::is_sanitized()) return;  // still in the tunnel
  EXPECT_NEAR(outside, 0.35, 0.06);
}

TEST(PipelineStereo, ImagesTooDarkAreToldAndShowNobody) {
  StereoUnit unit("[[light]]\nat = 0\nstate = \"tunnel\"\n");
  unit.obeys = false;
  for (std::size_t i = 0; i < 2; ++i) unit.simulation().device(i).set_exposure({20, 0});
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(unit.step().people.empty());
  EXPECT_FALSE(unit.report(0).usable);
  EXPECT_EQ(unit.report(0).unusable, 5U);
  EXPECT_EQ(unit.pipeline().depth_image(0).pixels, nullptr);
}

// What the drift monitor looks at.
TEST(PipelineStereo, TheMatchedDepthIsTold) {
  StereoUnit unit;
  for (int i = 0; i < 6; ++i) unit.step();
  SimulatedDevice& device = unit.simulation().device(1);
  const DepthImage depth = unit.pipeline().depth_image(1);
  const auto pixels = static_cast<std::size_t>(depth.width * depth.height);
  ASSERT_EQ(pixels, unit.pipeline().rays(1).size());
  std::vector<float> truth(pixels);
  device.stereo()->truth(device.world(), unit.instant(1), truth);
  std::vector<float> errors;
  for (std::size_t i = 0; i < pixels; ++i)
    if (depth.pixels[i] != 0 && truth[i] > 0)
      errors.push_back(std::abs(1e-3F * static_cast<float>(depth.pixels[i]) * truth[i] - 1));
  ASSERT_GT(errors.size(), pixels / 3);
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  EXPECT_LT(*middle, 0.03F);
  EXPECT_EQ(unit.pipeline().depth_image(2).pixels, nullptr);
}

TEST(PipelineStereo, ABentCameraIsFound) {
  StereoUnit unit("[[fault]]\nat = 0.7\nsensor = \"s1\"\nkind = \"bent\"\namount = 2.5\n");
  while (unit.time() < 3.8) unit.step();
  EXPECT_FALSE(unit.report(0).misaligned);
  EXPECT_TRUE(unit.report(1).misaligned);
  EXPECT_GT(std::abs(unit.report(1).row_offset_px), 1.5);
}

TEST(PipelineStereo, LensesThatDoNotFitTheCameraAreRefused) {
  const StereoUnit unit;
  Rig rig = unit.rig();
  rig.sensors[1].stereo.left.fx += 2;
  const auto made = Pipeline::create(rig, {}, wagon_of(unit.scene()), {});
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().message,
            "sensor s1: its rectified camera is not the one that follows from its lenses; pack the "
            "calibration again");
}

}  // namespace
}  // namespace wagonsight
