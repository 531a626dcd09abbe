#include "simulate/simulation.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "base/crc32c.h"
#include "counted_heap.h"
#include "support/scene_text.h"

namespace wagonsight {
namespace {

using Eigen::Vector3d;
using testing::act_text;
using testing::door_text;
using testing::passenger_text;
using testing::seat_text;
using testing::sensor_text;
using testing::wagon_text;

const std::string kRoom =
    wagon_text(6.0) + seat_text("s", "1.2, 0.35", 90) + door_text("door", 2.4, 3.6);

std::string sensors(const std::string& extra) {
  return sensor_text("k0", "kinect", "0.1, 0.1, 2.3", "3.2, 1.8, 0.3", extra) +
         sensor_text("k1", "kinect", "5.9, 0.1, 2.3", "2.8, 1.8, 0.3", extra) +
         sensor_text("k2", "kinect", "5.9, 2.6, 2.3", "2.8, 0.9, 0.3", extra) +
         sensor_text("k3", "kinect", "0.1, 2.6, 2.3", "3.2, 0.9, 0.3", extra);
}

Scene scene_of(const std::string& text) {
  auto scene = parse_scene(text, "test.toml");
  EXPECT_TRUE(scene.has_value()) << (scene ? "" : scene.error().message);
  return *scene;
}

struct Slot {
  Slot() : memory(std::size_t{640} * 480 * 2) { slot.bytes = memory; }
  std::vector<std::byte> memory;
  FrameSlot slot;
};

std::uint32_t checksum_of(const Scene& scene, std::uint64_t seed, int frames) {
  Simulation simulation(scene, seed);
  Slot s;
  std::uint32_t crc = 0;
  for (int i = 0; i < frames; ++i) {
    simulation.next(s.slot);
    crc = crc32c(s.slot.bytes, crc);
    crc ^= static_cast<std::uint32_t>(s.slot.device_ticks);
  }
  return crc;
}

const std::string kWalker = passenger_text("A", "start = [2.0, 1.3]\ncarries = ['bag']") +
                            act_text(0, "walk", "to = [4.5, 1.3]");

TEST(SimulationTest, TheSameSceneAndSeedGiveTheSameBytes) {
  const Scene scene = scene_of(kRoom + sensors("drop_rate = 0.1\n") + kWalker);
  EXPECT_EQ(checksum_of(scene, 11, 24), checksum_of(scene, 11, 24));
  EXPECT_NE(checksum_of(scene, 11, 24), checksum_of(scene, 12, 24));
}

TEST(SimulationTest, FramesComeInTheOrderOfTheirArrivalAt30HzWithTheirPhases) {
  const Scene scene = scene_of(kRoom + sensors("phase_ms = 7\ndrift_ppm = 50\n"));
  Simulation simulation(scene, 1);
  Slot s;
  HostTime last{};
  std::array<HostTime, 4> instant{};
  std::array<std::uint64_t, 4> ticks{};
  for (int i = 0; i < 40; ++i) {
    simulation.next(s.slot);
    EXPECT_GE(s.slot.arrival, last);
    last = s.slot.arrival;
    EXPECT_GT(s.slot.arrival, s.slot.instant);
    const std::size_t k = s.slot.sensor_index;
    if (ticks[k] > 0) {
      const double dt = to_seconds(s.slot.instant - instant[k]);
      EXPECT_NEAR(dt, 1.0 / 30 / (1 + 50e-6), 1e-7);
      const double counted = static_cast<double>(s.slot.device_ticks - ticks[k]);
      EXPECT_NEAR(counted / kTicksPerSecond, dt * (1 + 50e-6), 1e-7);
    } else {
      EXPECT_NEAR(to_seconds(s.slot.instant.time_since_epoch()), 0.007, 1e-9);
    }
    instant[k] = s.slot.instant;
    ticks[k] = s.slot.device_ticks;
  }
}

// Where a passenger is rendered is where the truth says that it is.
TEST(SimulationTest, TruthLiesWhereBodiesAreSeen) {
  const Scene scene = scene_of(
      kRoom + sensors("noise = 0\n") + passenger_text("standing", "start = [3.0, 1.5]") +
      passenger_text("sitting", "seat = 's'") +
      passenger_text("child", "build = 'child'\nstart = [4.4, 0.9]") +
      passenger_text("lying", "start = [3.4, 0.5]") + act_text(0, "fall", "to = [5.0, 0.5]"));
  Simulation simulation(scene, 4);
  const Rig rig = rig_of(scene);
  const HostTime when(from_seconds(3.0));
  PeopleFrame truth;
  simulation.truth_at(when, truth);
  ASSERT_EQ(truth.people.size(), 4U);
  std::array<std::vector<Vector3d>, 4> points;  // in the frame of each box
  for (std::size_t k = 0; k < 4; ++k) {
    SimulatedDevice& device = simulation.device(k);
    while (device.upcoming().instant < when) device.skip();
    Slot s;
    device.next(s.slot);
    for (int v = 0; v < 480; ++v) {
      for (int u = 0; u < 640; ++u) {
        const std::int32_t tag = device.kinect()->tag_at(u, v);
        const std::uint16_t z = s.slot.depth().at(u, v);
        if (tag <= 0 || z == 0) continue;
        const RigSensor& sensor = rig.sensors[k];
        const Vector3d p_W = sensor.X_WS * Vector3d(*ray_through(sensor.camera, {u, v}) * z * 1e-3);
        const Person& person = truth.people[static_cast<std::size_t>(tag - 1)];
        const Vector3d d = p_W - Vector3d(person.box.center.data());
        const double c = std::cos(person.box.yaw), sn = std::sin(person.box.yaw);
        points[static_cast<std::size_t>(tag - 1)].emplace_back(c * d.x() + sn * d.y(),
                                                               -sn * d.x() + c * d.y(), d.z());
      }
    }
  }
  for (std::size_t i = 0; i < 4; ++i) {
    ASSERT_GT(points[i].size(), 2000U) << scene.passengers[i].name;
    const Vector3d half = 0.5 * Vector3d(truth.people[i].box.size.data());
    std::size_t within = 0;
    Vector3d low = Vector3d::Constant(9), high = -low;
    for (const Vector3d& p : points[i]) {
      // One step of disparity is 3 cm at the far end of the wagon, half of it is the rounding.
      if ((p.cwiseAbs().array() <= half.array() + 0.03).all()) ++within;
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    EXPECT_GT(static_cast<double>(within), 0.995 * static_cast<double>(points[i].size()))
        << scene.passengers[i].name;
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_GT(high[axis] - low[axis], 0.8 * 2 * half[axis])
          << scene.passengers[i].name << " axis " << axis;
  }
}

TEST(SimulationTest, StillDepthIsThatOfTheRoom) {
  const Scene scene = scene_of(kRoom + sensors("noise = 0\n"));
  SimulatedDevice device(scene, 0, 1);
  Slot s;
  device.next(s.slot);
  const Rig rig = rig_of(scene);
  const RigSensor& sensor = rig.sensors[0];
  // A point of the free floor.
  const Vector3d floor(3.0, 1.4, 0.0);
  const Vector3d p_S = sensor.X_WS.inverse() * floor;
  const auto pixel = project(sensor.camera, p_S);
  ASSERT_TRUE(pixel.has_value());
  const int u = static_cast<int>(std::lround(pixel->x())),
            v = static_cast<int>(std::lround(pixel->y()));
  EXPECT_NEAR(s.slot.depth().at(u, v) * 1e-3, p_S.z(), 0.5 * sensor.noise.step(p_S.z()) + 0.012);
}

TEST(SimulationTest, FaultsAreFelt) {
  const std::string faults = R"([[fault]]
at = 1
sensor = "k0"
kind = "unplug"
for = 2
[[fault]]
at = 1
sensor = "k1"
kind = "late"
amount = 0.2
for = 1
[[fault]]
at = 0
sensor = "k2"
kind = "loss"
amount = 0.5
)";
  const Scene scene = scene_of(kRoom + sensors("") + faults);
  std::array<int, 3> count{};
  int during_unplug = 0, late = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    FrameClock clock(scene, k, 9);
    for (int i = 0; i < 300; ++i) {
      const FrameTiming timing = clock.next();
      const double t = to_seconds(timing.instant.time_since_epoch());
      if (timing.lost) continue;
      ++count[k];
      if (k == 0 && t >= 1 && t < 3) ++during_unplug;
      if (k == 1 && timing.arrival - timing.instant > std::chrono::milliseconds(150)) ++late;
    }
  }
  EXPECT_EQ(count[0], 240);
  EXPECT_EQ(during_unplug, 0);
  EXPECT_GE(late, 30);
  EXPECT_LE(late, 36);  // those after the fault queue up behind the late ones
  EXPECT_GT(count[2], 110);
  EXPECT_LT(count[2], 190);
}

TEST(SimulationTest, AMovedSensorSeesAnotherPictureAndTheSunBlinds) {
  const std::string windows = R"([[window]]
name = "w"
min = [0.5, -0.05, 1.0]
max = [5.5, 0.01, 2.0]
)";
  const auto valid_and_sum = [](const Scene& scene, double t) {
    SimulatedDevice device(scene, 3, 1);
    while (to_seconds(device.upcoming().instant.time_since_epoch()) < t) device.skip();
    Slot s;
    device.next(s.slot);
    double valid = 0, sum = 0;
    for (const std::uint16_t z : s.slot.depth_pixels()) valid += z > 0 ? 1 : 0, sum += z;
    return std::array<double, 2>{valid, sum};
  };
  const Scene plain = scene_of(kRoom + sensors("noise = 0\n") + windows);
  const Scene moved = scene_of(kRoom + sensors("noise = 0\n") + windows +
                               "[[fault]]\nat = 1\nsensor = \"k3\"\nkind = \"moved\"\n");
  const Scene sunny = scene_of(kRoom + sensors("noise = 0\n") + windows +
                               "[[light]]\nat = 1\nstate = \"sun\"\ndirection = [0, 0.8, -0.6]\n");
  EXPECT_EQ(valid_and_sum(plain, 0.5), valid_and_sum(moved, 0.5));
  EXPECT_GT(std::abs(valid_and_sum(plain, 2)[1] - valid_and_sum(moved, 2)[1]), 1e6);
  EXPECT_EQ(valid_and_sum(plain, 0.5), valid_and_sum(sunny, 0.5));
  EXPECT_LT(valid_and_sum(sunny, 2)[0], valid_and_sum(plain, 2)[0] - 5000);
}

TEST(SimulationTest, ProjectorsThatOverlapDisturbEachOther) {
  const auto valid_share = [](const Scene& scene) {
    SimulatedDevice device(scene, 0, 1);
    Slot s;
    double valid = 0;
    for (int i = 0; i < 5; ++i) {
      device.next(s.slot);
      for (const std::uint16_t z : s.slot.depth_pixels()) valid += z > 0 ? 1 : 0;
    }
    return valid / (5.0 * 640 * 480);
  };
  Scene together = scene_of(kRoom + sensors(""));
  Scene alone = together;
  alone.sensors.resize(1);
  EXPECT_LT(valid_share(together), valid_share(alone) - 0.002);
}

TEST(SimulationTest, TheProjectorsShadowLiesToTheLeftOfWhatIsNear) {
  const Scene scene = scene_of(kRoom + R"([[box]]
name = "plate"
min = [2.0, 1.2, 0.8]
max = [2.02, 1.6, 1.2]
[[sensor]]
name = "k"
kind = "kinect"
position = [0.1, 1.4, 1.0]
look_at = [5, 1.4, 1.0]
noise = 0
)");
  SimulatedDevice device(scene, 0, 1);
  Slot s;
  device.next(s.slot);
  // The plate is 1.9 m away, the wall 5.9 m: the shadow is f b (1/1.9 - 1/5.9) = 15.5 px wide.
  const int v = 240;
  int left = 220;  // left of this the side wall is near
  while (left < 640 && (s.slot.depth().at(left, v) == 0 || s.slot.depth().at(left, v) > 2500))
    ++left;
  int shadow = 0;
  while (s.slot.depth().at(left - 1 - shadow, v) == 0) ++shadow;
  EXPECT_GE(shadow, 12);
  EXPECT_LE(shadow, 17);
  int right = left;
  while (s.slot.depth().at(right, v) != 0 && s.slot.depth().at(right, v) < 2500) ++right;
  EXPECT_NE(s.slot.depth().at(right + 2, v), 0);
}

TEST(SimulationTest, NothingIsAllocatedOnceItRuns) {
  if (!allocations_are_counted()) GTEST_SKIP() << "the sanitizer has a heap of its own";
  const Scene scene = scene_of(
      kRoom + sensors("drop_rate = 0.05\n") + kWalker +
      passenger_text("a passenger with a long name and item", "door = 'door'") +
      act_text(0.2, "put", "item = 'a bag with a name of its own in red'") + act_text(1, "sit"));
  Simulation simulation(scene, 1);
  Slot s;
  PeopleFrame truth;
  const std::size_t before = allocation_count();
  for (int i = 0; i < 400; ++i) {
    simulation.next(s.slot);
    simulation.truth_at(s.slot.instant, truth);
  }
  EXPECT_EQ(allocation_count(), before);
  EXPECT_EQ(truth.people.size(), 2U);
}

class Immediate final : public Pace {
 public:
  bool wait_until(HostTime when, Duration) override {
    now = when;
    return true;
  }
  HostTime now{};
};

TEST(SimulatedSensorTest, FillsSlotsAndEnds) {
  const Scene scene = scene_of(kRoom + sensors("") + kWalker);
  Immediate pace;
  const HostTime start(std::chrono::seconds(1000));
  SimulatedSensor sensor(scene, 2, 1, pace, start, std::chrono::milliseconds(500));
  EXPECT_EQ(sensor.name(), "k2");
  FramePool pool(4, std::size_t{640} * 480 * 2);
  SpscRing<FrameSlot*> ring(4);
  std::uint64_t seen = 0;
  while (sensor.poll(std::chrono::milliseconds(10), pool, ring)) {
    FrameSlot* slot = nullptr;
    if (!ring.try_pop(slot)) continue;
    EXPECT_GE(slot->instant, start);
    EXPECT_EQ(slot->sensor_index, 2);
    ++seen;
    if (seen > 5) pool.release(slot);  // the first five are kept: one poll finds no slot
  }
  EXPECT_GT(sensor.counters().dropped, 0U);
  EXPECT_EQ(sensor.counters().frames, seen);
}

TEST(ScenesOfTheProject, AreAllReadAndPlayed) {
  std::size_t count = 0;
  for (const auto& entry :
       std::filesystem::directory_iterator(WAGONSIGHT_SOURCE_DIR "/config/scenes")) {
    if (entry.path().extension() != ".toml") continue;
    std::ifstream file(entry.path());
    std::stringstream text;
    text << file.rdbuf();
    const auto scene = parse_scene(text.str(), entry.path().filename().string());
    ASSERT_TRUE(scene.has_value()) << scene.error().message;
    EXPECT_EQ(scene->sensors.size(), 4U) << entry.path();
    World world(*scene, 3);
    PeopleFrame truth;
    std::size_t most = 0;
    for (double t = 0; t < 60; t += 0.5) {
      world.truth_at(HostTime(from_seconds(t)), truth);
      most = std::max(most, truth.people.size());
    }
    if (entry.path().stem() == "empty") {
      EXPECT_EQ(most, 0U);
    } else {
      EXPECT_GE(most, std::min<std::size_t>(scene->passengers.size(), 3U)) << entry.path();
    }
    ++count;
  }
  EXPECT_GE(count, 8U);
}

}  // namespace
}  // namespace wagonsight
