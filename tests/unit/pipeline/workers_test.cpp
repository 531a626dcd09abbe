#include "linux/workers.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "linux/sealed_heap.h"
#include "pipeline/pipeline.h"
#include "simulate/room.h"
#include "simulate/simulation.h"
#include "snapshot/json_lines.h"
#include "support/sanitized.h"

// The sensors of an instant, shared between threads.
namespace wagonsight {
namespace {

constexpr std::string_view kWagon = R"(
[wagon]
length = 6.0
width = 2.7
height = 2.4
[[door]]
name = "north"
from = [2.35, 2.7]
to = [3.65, 2.7]
[[sensor]]
name = "k0"
kind = "kinect"
position = [0.15, 1.35, 2.3]
look_at = [3.2, 1.35, 0.6]
[[sensor]]
name = "s0"
kind = "stereo"
position = [1.6, 0.08, 2.3]
look_at = [3.2, 1.7, 0.4]
[[sensor]]
name = "s1"
kind = "stereo"
position = [4.4, 0.08, 2.3]
look_at = [2.8, 1.7, 0.4]
[[passenger]]
name = "Anna"
height = 1.72
[[passenger.do]]
at = 0.4
act = "enter"
door = "north"
[[passenger.do]]
at = 1
act = "walk"
to = [3.0, 1.2]
)";

constexpr int kInstants = test::cases(40, 8);

// A few instants of three sensors, kept so that they can be shown twice.
class Recorded {
 public:
  Recorded() : scene_(*parse_scene(kWagon, "test")), simulation_(scene_, 5) {
    const std::size_t sensors = scene_.sensors.size();
    for (int i = 0; i < kInstants; ++i)
      for (std::size_t s = 0; s < sensors; ++s) {
        bytes_.emplace_back(simulation_.device(s).slot_bytes());
        slots_.emplace_back();
        slots_.back().bytes = bytes_.back();
        simulation_.device(s).next(slots_.back());
      }
  }

  // All that is told of these instants by so many workers; 0: no runner at all.
  std::string told_by(std::size_t workers) {
    Workers threads(workers);
    PipelineOptions options;
    options.learning_s = 0.3;
    if (workers > 0) options.runner = &threads;
    auto pipeline = Pipeline::create(rig_of(scene_), {}, wagon_of(scene_), options);
    EXPECT_TRUE(pipeline) << pipeline.error().message;
    threads.start();
    std::string told;
    const std::uint64_t before = sealed_allocations();
    std::size_t at = 0;
    for (int i = 0; i < kInstants; ++i) {
      FrameSet set;
      for (std::size_t s = 0; s < scene_.sensors.size(); ++s, ++at)
        set.sensors[s] = {FrameState::kPresent, &slots_[at], {}};
      set.instant = set.sensors[0].slot->instant;
      for (std::size_t s = 0; s < scene_.sensors.size(); ++s)
        set.sensors[s].skew = set.sensors[s].slot->instant - set.instant;
      append_people_line((*pipeline)->process(set), true, told);
      for (const FusedPoint& point : (*pipeline)->fused_points())
        told += std::to_string(point.x) + ',' + std::to_string(point.y) + '\n';
      for (std::size_t s = 1; s < scene_.sensors.size(); ++s)
        told += std::to_string((*pipeline)->stereo_report(s)->matched_share) + '\n';
    }
    EXPECT_EQ(sealed_allocations(), before) << "a worker allocated";
    const auto background = (*pipeline)->save_background();
    told.append(reinterpret_cast<const char*>(background.data()), background.size());
    return told;
  }

 private:
  Scene scene_;
  Simulation simulation_;
  std::vector<std::vector<std::byte>> bytes_;
  std::vector<FrameSlot> slots_;
};

TEST(PipelineWorkers, GiveTheSameBytesWhateverTheirNumber) {
  Recorded recorded;
  const std::string alone = recorded.told_by(0);
  EXPECT_GT(alone.size(), 10'000U);
  EXPECT_NE(alone.find('\n'), std::string::npos);
  EXPECT_TRUE(alone == recorded.told_by(1)) << "one worker tells something else than none";
  EXPECT_TRUE(alone == recorded.told_by(2)) << "two workers tell something else than one";
  EXPECT_TRUE(alone == recorded.told_by(3)) << "three workers tell something else than one";
}

}  // namespace
}  // namespace wagonsight
