#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "rig/rig.h"

// A scene as a person writes it: the wagon, its sensors, who does what and when, and what goes
// wrong. Metres, seconds and radians in here; the file states angles in degrees. World frame W:
// origin in a floor corner, x along the wagon, z up.
namespace wagonsight {

// What a surface does to infrared light; chosen by `material` of a [[box]].
enum class Material : std::uint8_t { kPlain, kDark, kMetal, kGlass, kScreen };

struct SceneSeat {
  std::string name;
  Eigen::Vector2d position = Eigen::Vector2d::Zero();
  double yaw = 0;  // the way a sitter looks, from +x
  double width = 0.5;
};
struct SceneDoor {
  std::string name;
  Eigen::Vector2d from = Eigen::Vector2d::Zero(), to = Eigen::Vector2d::Zero();
};
struct SceneBox {  // furniture, a window or a screen
  std::string name;
  Eigen::Vector3d min = Eigen::Vector3d::Zero(), max = Eigen::Vector3d::Zero();
  Material material = Material::kPlain;
};
// A ball that swings along a Lissajous figure, as somebody waves it on a thin stick.
struct SceneBall {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // of its middle
  Eigen::Vector3d swing = Eigen::Vector3d::Zero();     // to either side, metres
  double radius = 0.1;
  double period_s = 1.5;  // of its swing along x; y and z have their own

  Eigen::Vector3d centre_at(double seconds) const;
};
struct SceneZone {
  std::string name;
  std::vector<Eigen::Vector2d> polygon;
  int capacity = 0;
};
struct SceneSensor {
  std::string name;
  SensorKind kind = SensorKind::kKinect;
  Eigen::Vector3d position = Eigen::Vector3d::Zero(), look_at = Eigen::Vector3d::Zero();
  double phase_s = 0;
  double drift_ppm = 0;
  double drop_rate = 0;
  double stamp_late_s = 0;  // its clock reads the time so long after the light was taken
  double noise = 1;         // 0: ideal depth, only quantised
  double rate_hz = 30;
};

enum class ActKind : std::uint8_t {
  kEnter,
  kWalk,
  kStand,
  kSit,
  kLean,
  kFall,
  kLie,
  kRise,
  kPut,
  kTake,
  kLeave,
};
struct SceneAct {
  double at = 0;
  ActKind kind = ActKind::kStand;
  std::optional<Eigen::Vector2d> to;
  int seat = -1;     // index into Scene::seats
  int door = -1;     // index into Scene::doors
  double speed = 0;  // 0: the passenger's own
  std::string item;
};

enum class BuildKind : std::uint8_t { kAdult, kChild };
struct ScenePassenger {
  std::string name;
  BuildKind build = BuildKind::kAdult;
  double height = 1.74;
  bool bag = false, pram = false, coat = false;
  std::optional<Eigen::Vector2d> start;
  int door = -1;
  int seat = -1;  // sits there from the beginning
  std::vector<SceneAct> acts;
};

enum class LightState : std::uint8_t { kDay, kTunnel, kSun };
struct SceneLight {
  double at = 0;
  LightState state = LightState::kDay;
  Eigen::Vector3d direction{0.3, 0.8, -0.5};  // in which the sun's light travels
};

enum class FaultKind : std::uint8_t { kUnplug, kLate, kLoss, kMoved, kBent };
struct SceneFault {
  double at = 0;
  int sensor = 0;
  FaultKind kind = FaultKind::kUnplug;
  double for_s = 0;   // how long; endless when it was not stated
  double amount = 0;  // kLate: seconds; kLoss: share 0..1; kMoved: metres; kBent: rows
};

struct Scene {
  // Acts, lights and faults begin again after so many seconds; 0: never. Passengers go on from
  // where they are.
  double repeat_s = 0;
  double length = 6.0, width = 2.7, height = 2.4;
  std::vector<SceneSeat> seats;
  std::vector<SceneDoor> doors;
  std::vector<SceneBox> boxes, windows, screens;
  std::vector<SceneZone> zones;
  std::vector<SceneBall> balls;
  std::vector<SceneSensor> sensors;
  std::vector<ScenePassenger> passengers;
  std::vector<SceneLight> lights;  // by time
  std::vector<SceneFault> faults;
};

// Seconds since the scene began, the last time that it did.
double time_in(const Scene& scene, double seconds);

// Reads a scene from TOML text. `file_name` is only told in errors, which read
// "FILE:LINE: KEY = VALUE: RULE". Unknown keys are errors. Allocates; for start-up.
Result<Scene> parse_scene(std::string_view text, std::string_view file_name);

}  // namespace wagonsight
