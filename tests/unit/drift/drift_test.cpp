// The drift monitor in a room whose truth is known.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fmt/format.h>

#include <numbers>

#include "drift/drift_monitor.h"
#include "room.h"

namespace wagonsight {
namespace {

using drift_test::Box;
using drift_test::make_sensor;
using drift_test::Room;
using drift_test::wagon_boxes;
using testing::Contains;
using testing::HasSubstr;
using testing::MatchesRegex;

constexpr double kDegree = std::numbers::pi / 180;

// Where the sensor would stand after a shift in its own frame and a turn about `axis`.
Rigid moved(const Rigid& X_WS, const Eigen::Vector3d& shift_S, double degrees,
            const Eigen::Vector3d& axis = {0.3, 0.8, 0.5}) {
  return X_WS * Rigid{Eigen::Quaterniond(Eigen::AngleAxisd(degrees * kDegree, axis.normalized())),
                      shift_S};
}

struct Watch {
  RigSensor sensor = make_sensor();
  Room room{sensor, wagon_boxes()};
  SensorDrift drift{sensor, room.rays, {}, DriftOptions()};
  unsigned seed = 1;

  Watch() {
    while (drift.state() == SensorDrift::State::kLearning)
      drift.add(room.look(sensor.X_WS, ++seed), {});
  }
  // Judgements until the alarm, or 0.
  int windows_to_alarm(const Rigid& X_WS, int windows, double scale = 1,
                       const std::vector<Box>& people = {}, const std::vector<KeepOut>& told = {}) {
    const int before = drift.judgements();
    while (drift.judgements() < before + windows) {
      drift.add(room.look(X_WS, ++seed, scale, people), told);
      if (drift.state() == SensorDrift::State::kMoved) return drift.judgements() - before;
    }
    return 0;
  }
};

std::string told_by(const SensorDrift& drift) {
  const SensorMotion& motion = drift.motion();
  std::string text =
      fmt::format("{} points, {:.2f} fit, shift {:.1f} +- {:.1f} mm", motion.points,
                  motion.fitting_share, motion.shift_m.norm() * 1e3, motion.sigma_shift_m * 1e3);
  for (const std::string& vague : motion.vague) text += ", " + vague;
  return text;
}

TEST(SensorDrift, MeasuresAShiftAndATurnAgainstTheTruth) {
  Watch watch;
  const Eigen::Vector3d shift(0.006, -0.004, 0.012);
  const Rigid X_WS = moved(watch.sensor.X_WS, shift, 0.25);
  EXPECT_EQ(watch.windows_to_alarm(X_WS, 4), 2);
  const SensorMotion& motion = watch.drift.motion();
  EXPECT_LT((motion.shift_m - shift).norm(), 0.002);
  const Eigen::Vector3d turn = 0.25 * kDegree * Eigen::Vector3d(0.3, 0.8, 0.5).normalized();
  EXPECT_LT((motion.turn_rad - turn).norm(), 0.04 * kDegree);
  EXPECT_NEAR(motion.scale, 1, 0.001);
  EXPECT_TRUE(motion.vague.empty());
}

TEST(SensorDrift, AlarmsAtTheLimitsAndNotAtHalfOfThem) {
  for (const Eigen::Vector3d& along :
       {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0, 0, 1)}) {
    Watch watch;
    const Rigid at = watch.sensor.X_WS;
    EXPECT_EQ(watch.windows_to_alarm(at, 5), 0);
    EXPECT_EQ(watch.windows_to_alarm(moved(at, 0.005 * along, 0), 5), 0);
    EXPECT_GT(watch.windows_to_alarm(moved(at, 0.010 * along, 0), 3), 0);
    Watch turned;
    EXPECT_EQ(turned.windows_to_alarm(moved(at, {0, 0, 0}, 0.1, along), 5), 0);
    EXPECT_GT(turned.windows_to_alarm(moved(at, {0, 0, 0}, 0.31, along), 3), 0);
  }
}

TEST(SensorDrift, CallsAWarmUpScaleAndNotAShift) {
  Watch watch;
  EXPECT_EQ(watch.windows_to_alarm(watch.sensor.X_WS, 5, 1.01), 0);
  EXPECT_NEAR(watch.drift.motion().scale, 1 / 1.01, 0.0015);
  EXPECT_LT(watch.drift.motion().shift_m.norm(), 0.004);
}

TEST(SensorDrift, IsNotFooledByPassengers) {
  Watch watch;
  std::vector<Box> people;
  std::vector<KeepOut> told;
  for (const double x : {1.7, 2.3, 2.8, 3.4, 4.1, 4.8})
    for (const double y : {0.4, 1.3, 2.2}) {
      people.emplace_back(Eigen::Vector3d(x - 0.2, y - 0.25, 0),
                          Eigen::Vector3d(x + 0.2, y + 0.25, 1.7));
      told.push_back({people.back().min().cast<float>().array() - 0.1F,
                      people.back().max().cast<float>().array() + 0.1F});
    }
  // Told of them or not, leaning on the seats as they are.
  const Rigid& at = watch.sensor.X_WS;
  EXPECT_EQ(watch.windows_to_alarm(at, 3, 1, people, told), 0);
  EXPECT_EQ(watch.windows_to_alarm(at, 3, 1, people), 0);
  // So full a wagon, and nobody stirs: a sixteenth of the points is left. What it tells badly is
  // named, and a shift of 14 mm is told nevertheless.
  EXPECT_THAT(watch.drift.motion().vague, Contains(HasSubstr("shift to the side")));
  EXPECT_LT(watch.drift.motion().points, 2000);
  const Rigid away = moved(at, {0.011, 0, 0.008}, 0);
  EXPECT_GT(watch.windows_to_alarm(away, 4, 1, people, told), 0) << told_by(watch.drift);
  Watch untold;
  EXPECT_GT(untold.windows_to_alarm(away, 4, 1, people), 0) << told_by(untold.drift);
}

TEST(SensorDrift, GoesBackToRestWhenTheSensorIsPutBack) {
  Watch watch;
  ASSERT_GT(watch.windows_to_alarm(moved(watch.sensor.X_WS, {0.02, 0, 0}, 0), 3), 0);
  for (int i = 0; i < 20 * 7; ++i)
    watch.drift.add(watch.room.look(watch.sensor.X_WS, ++watch.seed), {});
  EXPECT_EQ(watch.drift.state(), SensorDrift::State::kWatching);
}

TEST(SensorDrift, SaysWhenItLooksElsewhere) {
  Watch watch;
  EXPECT_GT(watch.windows_to_alarm(moved(watch.sensor.X_WS, {0, 0, 0}, 25, {0, 1, 0}), 4), 0);
  EXPECT_TRUE(watch.drift.looks_elsewhere() || watch.drift.motion().turn_rad.norm() > 0.02);
}

TEST(SensorDrift, ACoveredSensorIsNoMovedOne) {
  Watch watch;
  const std::vector<Box> cloth = {Box(Eigen::Vector3d(0.4, 0, 0), Eigen::Vector3d(0.8, 2.7, 2.4))};
  EXPECT_EQ(watch.windows_to_alarm(watch.sensor.X_WS, 4, 1, cloth), 0);
}

TEST(Registration, NamesWhatALongCorridorCannotTell) {
  // Two walls, floor and ceiling, nothing along x: a shift along it changes nothing that is seen.
  RigSensor sensor = make_sensor();
  sensor.X_WS = {look_at({0.3, 1.35, 1.2}, {9, 1.35, 1.2}), {0.3, 1.35, 1.2}};
  const Room room(sensor, {}, Box(Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(60, 2.7, 2.4)));
  SensorDrift drift(sensor, room.rays, {}, DriftOptions());
  unsigned seed = 1;
  while (drift.judgements() < 3) {
    const Rigid at = drift.state() == SensorDrift::State::kLearning
                         ? sensor.X_WS
                         : moved(sensor.X_WS, {0, 0, 0.03}, 0);
    drift.add(room.look(at, ++seed), {});
  }
  ASSERT_TRUE(drift.motion().known);
  EXPECT_THAT(drift.motion().vague, Contains(HasSubstr("shift along its axis")));
  EXPECT_EQ(drift.state(), SensorDrift::State::kWatching);
}

TEST(DriftMonitor, TellsInWordsAndKeepsItsModelInAFile) {
  Rig rig;
  rig.sensors.push_back(make_sensor());
  const Room room(rig.sensors[0], wagon_boxes());
  std::array<RayTable, kSensorsMax> rays{};
  rays[0] = room.rays;
  DriftMonitor monitor(rig, rays, {});
  EXPECT_THAT(monitor.text(), HasSubstr("1 sensor learns the empty wagon"));
  unsigned seed = 1;
  while (monitor.sensor(0).state() == SensorDrift::State::kLearning)
    monitor.add(0, room.look(rig.sensors[0].X_WS, ++seed), {});
  StaticModel model = monitor.model();
  model.blob_sha256[3] = 77;
  const auto bytes = format_static_model(model);
  const auto read = parse_static_model(bytes);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->blob_sha256, model.blob_sha256);
  DriftMonitor second(rig, rays, *read);
  EXPECT_EQ(second.sensor(0).state(), SensorDrift::State::kWatching);
  EXPECT_FALSE(second.alarm());
  while (!second.alarm() && seed < 200)
    second.add(0, room.look(moved(rig.sensors[0].X_WS, {0.015, 0, 0}, 0), ++seed), {});
  ASSERT_TRUE(second.alarm());
  EXPECT_THAT(second.text(), MatchesRegex("k0 by 1[45] mm .right .1[45],.*"));
  // Damage of any byte is seen.
  for (std::size_t at = 0; at < bytes.size(); at += 97) {
    auto damaged = bytes;
    damaged[at] ^= std::byte{0x10};
    EXPECT_FALSE(parse_static_model(damaged));
    EXPECT_FALSE(parse_static_model(std::span(bytes).first(at)));
  }
}

}  // namespace
}  // namespace wagonsight
