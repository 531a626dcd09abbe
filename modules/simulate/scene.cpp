#include "simulate/scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/capacities.h"
#include "simulate/table_reader.h"

namespace wagonsight {
namespace {

constexpr double kForever = 1e9;  // seconds
constexpr double kDegree = std::numbers::pi / 180;
constexpr std::size_t kBallsMax = 8;

constexpr std::array<std::string_view, 5> kMaterials{"plain", "dark", "metal", "glass", "screen"};
constexpr std::array<std::string_view, 2> kKinds{"kinect", "stereo"};
constexpr std::array<std::string_view, 2> kBuilds{"adult", "child"};
constexpr std::array<std::string_view, 3> kCarried{"bag", "pram", "coat"};
constexpr std::array<std::string_view, 11> kActs{"enter", "walk", "stand", "sit",  "lean", "fall",
                                                 "lie",   "rise", "put",   "take", "leave"};
constexpr std::array<std::string_view, 3> kLights{"day", "tunnel", "sun"};
constexpr std::array<std::string_view, 5> kFaults{"unplug", "late", "loss", "moved", "bent"};

template <class T>
int index_of(const std::vector<T>& items, const std::string& name) {
  const auto found =
      std::find_if(items.begin(), items.end(), [&](const T& item) { return item.name == name; });
  return found == items.end() ? -1 : static_cast<int>(found - items.begin());
}

// The index of what `key` names among `items`; -1 when the key is absent.
template <class T>
int reference(SceneReader& reader, std::string_view key, const std::vector<T>& items,
              std::string_view kind) {
  if (!reader.has(key)) {
    reader.text(key, "");  // so that the key counts as known
    return -1;
  }
  const std::string name = reader.text(key, std::nullopt);
  const int index = index_of(items, name);
  if (index < 0) reader.refuse(key, fmt::format("no [[{}]] has this name", kind));
  return index;
}

template <class T>
std::string unique_name(SceneReader& reader, const std::vector<T>& others, std::string fallback) {
  std::string name = reader.text("name", std::move(fallback));
  if (index_of(others, name) >= 0) reader.refuse("name", "another one has this name already");
  return name;
}

void read_wagon(SceneReader& root, Scene& scene) {
  auto wagons = root.tables("wagon", 1);
  if (wagons.empty()) {
    root.refuse("wagon", "a scene needs a table [wagon]");
    return;
  }
  SceneReader& wagon = wagons.front();
  scene.length = wagon.number("length", 1.5, 40, std::nullopt);
  scene.width = wagon.number("width", 1.5, 20, std::nullopt);
  scene.height = wagon.number("height", 1.8, 6, std::nullopt);
  wagon.finish();
}

// A point on the floor of the wagon, a little tolerance included.
std::optional<Eigen::Vector2d> floor_point(SceneReader& reader, std::string_view key,
                                           const Scene& scene, bool needed, double margin) {
  const auto p = reader.point2(key, needed);
  if (!p) return p;
  if (p->x() < -margin || p->y() < -margin || p->x() > scene.length + margin ||
      p->y() > scene.width + margin)
    reader.refuse(key, fmt::format("must lie in the wagon, x from 0 to {}, y from 0 to {}",
                                   scene.length, scene.width));
  return p;
}

void read_seats(SceneReader& root, Scene& scene) {
  for (SceneReader& reader : root.tables("seat", kSeatsMax)) {
    SceneSeat seat;
    seat.name = unique_name(reader, scene.seats, fmt::format("seat {}", scene.seats.size() + 1));
    seat.position = floor_point(reader, "position", scene, true, 0).value_or(seat.position);
    seat.yaw = reader.number("yaw", -360, 360, 0.0) * kDegree;
    seat.width = reader.number("width", 0.3, 3, 0.5);
    reader.finish();
    scene.seats.push_back(std::move(seat));
  }
}

void read_doors(SceneReader& root, Scene& scene) {
  constexpr double kBesideWall = 0.3;  // metres; a threshold may be drawn on the outer side
  for (SceneReader& reader : root.tables("door", kDoorsMax)) {
    SceneDoor door;
    door.name = unique_name(reader, scene.doors, fmt::format("door {}", scene.doors.size() + 1));
    door.from = floor_point(reader, "from", scene, true, kBesideWall).value_or(door.from);
    door.to = floor_point(reader, "to", scene, true, kBesideWall)
                  .value_or(door.from + Eigen::Vector2d(1, 0));
    if ((door.to - door.from).norm() < 0.4)
      reader.refuse("to", "must be at least 0.4 m from `from`, so that a person fits through");
    reader.finish();
    scene.doors.push_back(std::move(door));
  }
}

void read_boxes(SceneReader& root, std::string_view key, Material otherwise, std::size_t count_max,
                std::vector<SceneBox>& boxes) {
  for (SceneReader& reader : root.tables(key, count_max)) {
    SceneBox box;
    box.name = reader.text("name", fmt::format("{} {}", key, boxes.size() + 1));
    box.min = reader.point3("min", true).value_or(box.min);
    box.max = reader.point3("max", true).value_or(box.min + Eigen::Vector3d::Ones());
    if ((box.max.array() < box.min.array()).any())
      reader.refuse("max", "must not be less than `min` in any coordinate");
    box.material = otherwise;
    if (key == "box")
      box.material =
          static_cast<Material>(reader.choice("material", kMaterials, static_cast<int>(otherwise)));
    reader.finish();
    boxes.push_back(std::move(box));
  }
}

void read_zones(SceneReader& root, Scene& scene) {
  for (SceneReader& reader : root.tables("zone", kZonesMax)) {
    SceneZone zone;
    zone.name = unique_name(reader, scene.zones, fmt::format("zone {}", scene.zones.size() + 1));
    zone.polygon = reader.polygon("polygon", kZoneCornersMax);
    zone.capacity = reader.whole("capacity", 0, 1000, 0);
    reader.finish();
    scene.zones.push_back(std::move(zone));
  }
}

void read_balls(SceneReader& root, Scene& scene) {
  for (SceneReader& reader : root.tables("ball", kBallsMax)) {
    SceneBall ball;
    ball.position = reader.point3("position", true).value_or(ball.position);
    ball.swing = reader.point3("swing", false).value_or(ball.swing);
    ball.radius = reader.number("radius", 0.02, 0.5, ball.radius);
    ball.period_s = reader.number("period", 0.2, 60, ball.period_s);
    reader.finish();
    scene.balls.push_back(ball);
  }
}

void read_sensors(SceneReader& root, Scene& scene) {
  for (SceneReader& reader : root.tables("sensor", kSensorsMax)) {
    SceneSensor sensor;
    sensor.name = unique_name(reader, scene.sensors, fmt::format("k{}", scene.sensors.size()));
    sensor.kind = static_cast<SensorKind>(reader.choice("kind", kKinds, 0));
    sensor.position = reader.point3("position", true).value_or(sensor.position);
    sensor.look_at =
        reader.point3("look_at", true).value_or(sensor.position + Eigen::Vector3d::UnitX());
    if ((sensor.look_at - sensor.position).norm() < 0.01)
      reader.refuse("look_at", "must be at least 1 cm from `position`");
    sensor.phase_s = reader.number("phase_ms", -1000, 1000, 0.0) * 1e-3;
    sensor.drift_ppm = reader.number("drift_ppm", -10000, 10000, 0.0);
    sensor.drop_rate = reader.number("drop_rate", 0, 1, 0.0);
    sensor.stamp_late_s = reader.number("stamp_late_ms", 0, 100, 0.0) * 1e-3;
    sensor.noise = reader.number("noise", 0, 10, 1.0);
    constexpr double kKinectRate_hz = 30, kStereoRate_hz = 14;
    sensor.rate_hz = reader.number(
        "rate_hz", 0.5, 60, sensor.kind == SensorKind::kStereo ? kStereoRate_hz : kKinectRate_hz);
    reader.finish();
    scene.sensors.push_back(std::move(sensor));
  }
}

SceneAct read_act(SceneReader& reader, const Scene& scene) {
  SceneAct act;
  act.at = reader.number("at", 0, 1e7, 0.0);
  act.kind = static_cast<ActKind>(reader.choice("act", kActs, std::nullopt));
  act.to = floor_point(reader, "to", scene, false, 0);
  act.seat = reference(reader, "seat", scene.seats, "seat");
  act.door = reference(reader, "door", scene.doors, "door");
  act.speed = reader.number("speed", 0.05, 8, 0.0 + 0.05);
  if (!reader.has("speed")) act.speed = 0;
  act.item = reader.text("item", "");
  const bool handles_item = act.kind == ActKind::kPut || act.kind == ActKind::kTake;
  if (handles_item && act.item.empty()) act.item = "bag";
  const bool uses_door = act.kind == ActKind::kEnter || act.kind == ActKind::kLeave;
  if (uses_door && scene.doors.empty()) reader.refuse("act", "the scene has no [[door]]");
  if (act.kind == ActKind::kSit && act.seat < 0 && scene.seats.empty())
    reader.refuse("act", "the scene has no [[seat]]");
  if (act.kind == ActKind::kWalk && !act.to && act.seat < 0 && act.door < 0)
    reader.refuse("act", "walk needs one of to = [x, y], seat = \"NAME\" or door = \"NAME\"");
  reader.finish();
  return act;
}

ScenePassenger read_passenger(SceneReader& reader, const Scene& scene) {
  ScenePassenger passenger;
  passenger.name = unique_name(reader, scene.passengers,
                               fmt::format("passenger {}", scene.passengers.size() + 1));
  passenger.build = static_cast<BuildKind>(reader.choice("build", kBuilds, 0));
  const bool child = passenger.build == BuildKind::kChild;
  passenger.height = reader.number("height", 0.6, 2.3, child ? 1.2 : 1.74);
  for (const std::string& carried : reader.texts("carries", kCarried)) {
    passenger.bag |= carried == "bag";
    passenger.pram |= carried == "pram";
    passenger.coat |= carried == "coat";
  }
  passenger.start = floor_point(reader, "start", scene, false, 0);
  passenger.door = reference(reader, "door", scene.doors, "door");
  passenger.seat = reference(reader, "seat", scene.seats, "seat");
  constexpr std::size_t kActsMax = 1000;
  for (SceneReader& act : reader.tables("do", kActsMax))
    passenger.acts.push_back(read_act(act, scene));
  const auto earlier = [](const SceneAct& a, const SceneAct& b) { return a.at < b.at; };
  std::stable_sort(passenger.acts.begin(), passenger.acts.end(), earlier);
  const bool enters = !passenger.acts.empty() && passenger.acts.front().kind == ActKind::kEnter;
  if (!passenger.start && passenger.door < 0 && passenger.seat < 0 && !enters)
    reader.refuse("start", "a passenger needs start = [x, y], door = \"NAME\" or seat = \"NAME\"");
  reader.finish();
  return passenger;
}

void read_lights(SceneReader& root, Scene& scene) {
  for (SceneReader& reader : root.tables("light", 64)) {
    SceneLight light;
    light.at = reader.number("at", 0, 1e7, 0.0);
    light.state = static_cast<LightState>(reader.choice("state", kLights, std::nullopt));
    light.direction = reader.point3("direction", false).value_or(light.direction);
    if (light.direction.norm() < 1e-6) reader.refuse("direction", "must not be all zero");
    light.direction.normalize();
    reader.finish();
    scene.lights.push_back(light);
  }
  const auto earlier = [](const SceneLight& a, const SceneLight& b) { return a.at < b.at; };
  std::stable_sort(scene.lights.begin(), scene.lights.end(), earlier);
}

// `amount` of a late fault is seconds; numbers above 5 can only be meant as milliseconds.
double fault_amount(SceneReader& reader, FaultKind kind) {
  switch (kind) {
    case FaultKind::kLate: {
      const double amount = reader.number("amount", 0, 5000, 0.1);
      return amount > 5 ? amount * 1e-3 : amount;
    }
    case FaultKind::kLoss:
      return reader.number("amount", 0, 1, 0.3);
    case FaultKind::kMoved:
      return reader.number("amount", -1, 1, 0.05);
    case FaultKind::kBent:
      return reader.number("amount", -20, 20, 3);
    case FaultKind::kUnplug:
      break;
  }
  return reader.number("amount", 0, 1e6, 0.0);  // said of an unplug it means nothing
}

void read_faults(SceneReader& root, Scene& scene) {
  for (SceneReader& reader : root.tables("fault", 256)) {
    SceneFault fault;
    fault.at = reader.number("at", 0, 1e7, 0.0);
    fault.sensor = reference(reader, "sensor", scene.sensors, "sensor");
    if (!reader.has("sensor")) reader.refuse("sensor", "this key is needed");
    fault.kind = static_cast<FaultKind>(reader.choice("kind", kFaults, std::nullopt));
    fault.for_s = reader.number("for", 0, kForever, kForever);
    fault.amount = fault_amount(reader, fault.kind);
    if (fault.kind == FaultKind::kBent && fault.sensor >= 0 &&
        scene.sensors[static_cast<std::size_t>(fault.sensor)].kind != SensorKind::kStereo)
      reader.refuse("kind", "only a stereo camera can be bent");
    reader.finish();
    scene.faults.push_back(fault);
  }
}

}  // namespace

Eigen::Vector3d SceneBall::centre_at(double seconds) const {
  // No two axes share a harmonic, so that no two instants of some seconds look alike.
  constexpr std::array<double, 3> kFaster{1, 0.73, 1.37};
  Eigen::Vector3d centre = position;
  for (int axis = 0; axis < 3; ++axis)
    centre[axis] += swing[axis] * std::sin(2 * std::numbers::pi * seconds *
                                               kFaster[static_cast<std::size_t>(axis)] / period_s +
                                           axis);
  return centre;
}

double time_in(const Scene& scene, double seconds) {
  return scene.repeat_s > 0 ? std::fmod(seconds, scene.repeat_s) : seconds;
}

Result<Scene> parse_scene(std::string_view text, std::string_view file_name) {
  toml::parse_result parsed = toml::parse(text);
  if (!parsed) {
    const toml::parse_error& error = parsed.error();
    return fail(fmt::format("{}:{}: not valid TOML: {}", file_name, error.source().begin.line,
                            error.description()));
  }
  std::optional<Error> error;
  SceneReader root(parsed.table(), "", file_name, error);
  Scene scene;
  scene.repeat_s = root.number("repeat", 1, 1e7, 1.0);
  if (!root.has("repeat")) scene.repeat_s = 0;
  read_wagon(root, scene);
  read_seats(root, scene);
  read_doors(root, scene);
  read_boxes(root, "box", Material::kPlain, 512, scene.boxes);
  read_boxes(root, "window", Material::kGlass, kMasksMax / 2, scene.windows);
  read_boxes(root, "screen", Material::kScreen, kMasksMax / 2, scene.screens);
  read_zones(root, scene);
  read_balls(root, scene);
  read_sensors(root, scene);
  for (SceneReader& reader : root.tables("passenger", kPeopleMax))
    scene.passengers.push_back(read_passenger(reader, scene));
  read_lights(root, scene);
  read_faults(root, scene);
  root.finish();
  if (error) return tl::unexpected<Error>(*error);
  return scene;
}

}  // namespace wagonsight
