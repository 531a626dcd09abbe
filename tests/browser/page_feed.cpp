// Feeds the real web side with a scripted wagon, so that the page can be looked at and tested
// without sensors. Prints the page's address, then obeys lines on stdin:
//   pause | resume      stop and go on publishing
//   lose NAME | find NAME   a sensor's state
//   fall | rise         person 3 lies on the floor, with the event
//   kill                ends the web side as a crash would
//   quit
#include <fcntl.h>
#include <time.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <memory>
#include <numbers>
#include <string>
#include <thread>

#include "http/server.h"
#include "shared_block.h"
#include "web_supervisor.h"

namespace wagonsight {
namespace {

double monotonic_seconds() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

constexpr double kLength = 6.0, kWidth = 2.7, kHeight = 2.4;

UnitInfo make_unit() {
  auto unit = std::make_unique<UnitInfo>();
  unit->name = "Demo wagon";
  unit->version = "0.1.0 (page feed)";
  unit->simulated = true;
  unit->settings.assign("[unit]\nname = \"Demo wagon\"\n");
  Plan& plan = unit->plan;
  plan.inside_max = {kLength, kWidth, kHeight};
  const auto zone = [&](const char* name, double x0, double x1, std::uint32_t capacity) {
    PlanZone z;
    z.name = name;
    z.capacity = capacity;
    for (const auto& corner : {std::array{x0, 0.0}, {x1, 0.0}, {x1, kWidth}, {x0, kWidth}})
      z.polygon.push_back(corner);
    plan.zones.push_back(z);
  };
  zone("front", 0, 2.0, 10);
  zone("middle", 2.0, 4.0, 12);
  zone("rear", 4.0, 6.0, 10);
  for (int side = 0; side < 2; ++side)
    for (int i = 0; i < 5; ++i) {
      const double x = (i < 2 ? 0.6 : 2.05) + 0.55 * i;
      const double yaw = (side == 0 ? 0.5 : -0.5) * std::numbers::pi;
      plan.seats.push_back({Name((side == 0 ? "L" : "R") + std::to_string(i + 1)),
                            {i == 4 ? 5.2 : x, side == 0 ? 0.3 : kWidth - 0.3},
                            yaw,
                            0.5});
    }
  plan.doors.push_back({"door A", {1.9, 0}, {2.9, 0}});
  plan.doors.push_back({"door B", {1.9, kWidth}, {2.9, kWidth}});
  plan.masks.push_back({"window", {3.2, -0.1}, {4.9, 0.05}});
  plan.masks.push_back({"screen", {5.9, 1.0}, {6.05, 1.7}});
  const double a = 1 / std::numbers::sqrt2;
  plan.sensors.push_back({"k0", {0.15, 0.15, 2.3}, {a, a}, 1.0, 4.0});
  plan.sensors.push_back({"k1", {5.85, 0.15, 2.3}, {-a, a}, 1.0, 4.0});
  plan.sensors.push_back({"k2", {5.85, 2.55, 2.3}, {-a, -a}, 1.0, 4.0});
  plan.sensors.push_back({"k3", {0.15, 2.55, 2.3}, {a, -a}, 1.0, 4.0});
  return *unit;
}

class Feed {
 public:
  explicit Feed(const UnitInfo& unit) : unit_(unit), snapshot_(std::make_unique<Snapshot>()) {
    Snapshot& s = *snapshot_;
    for (const PlanSensor& sensor : unit.plan.sensors) {
      SensorStatus status;
      status.name = sensor.name;
      status.kind = "kinect";
      status.state = SensorState::kOk;
      status.expected_fps = 30;
      status.background_share = 0.97;
      status.rms_px = 0.27;
      s.sensors.push_back(status);
    }
    for (const char* stage : {"to depth", "extract", "fuse", "people", "situation"})
      s.stages.push_back({stage, 0, 0, 0});
    s.calibration.present = true;
    s.calibration.source = "simulated";
    s.calibration.has_georeference = true;
    s.calibration.georeference_sigma_m = 0.003;
    s.resident_bytes = 41UL << 20U;
    s.slots_capacity = 24;
    s.slots_high_water = 9;
  }

  const Snapshot& at(double t) {
    Snapshot& s = *snapshot_;
    ++s.sequence;
    s.time = t;
    s.monotonic_time = monotonic_seconds();
    s.unix_time = 1.76e9 + t;
    s.framesets = static_cast<std::uint64_t>(t * 30);
    s.frameset_rate = 30 + 0.1 * std::sin(t);
    s.pipeline_latency_ms = 24 + 3 * std::sin(t / 2);
    s.pipeline_cpu_share = 0.31 + 0.02 * std::sin(t / 5);
    move_people(s, t);
    count(s);
    tell_sensors(s, t);
    return s;
  }

  SensorStatus* sensor(std::string_view name) {
    for (SensorStatus& sensor : snapshot_->sensors)
      if (sensor.name == name) return &sensor;
    return nullptr;
  }
  bool fallen = false;

 private:
  static Person person(std::uint32_t id, double x, double y, double height, Posture posture) {
    Person p;
    p.id = id;
    p.position = {x, y};
    p.height = height;
    p.posture = posture;
    p.sigma = {0.02, 0.03};
    p.box = {{x, y, height / 2}, {0.5, 0.4, height}, 0};
    p.ellipsoid.center = p.box.center;
    p.ellipsoid.semi_axes = {height / 2, 0.25, 0.2};
    return p;
  }
  void move_people(Snapshot& s, double t) {
    s.frame.time = t;
    s.frame.people.clear();
    s.frame.events.clear();
    const double phase = t * 0.35;
    Person walker = person(1, 3.0 + 2.3 * std::cos(phase), kWidth / 2 + 0.3 * std::sin(2 * phase),
                           1.78, Posture::kStanding);
    walker.velocity = {-2.3 * 0.35 * std::sin(phase), 0.3 * 0.7 * std::cos(2 * phase)};
    s.frame.people.push_back(walker);
    s.frame.people.push_back(
        person(2, unit_.plan.seats[1].position[0], 0.42, 1.66, Posture::kSitting));
    Person third = person(3, 4.2, 1.9, 1.71, fallen ? Posture::kLying : Posture::kStanding);
    s.frame.people.push_back(third);
    s.frame.people.push_back(
        person(5, unit_.plan.seats[8].position[0], kWidth - 0.42, 1.31, Posture::kSitting));
    Person child = person(7, 1.2 + 0.5 * std::sin(t * 0.5), 1.2, 1.12, Posture::kStanding);
    child.velocity = {0.25 * std::cos(t * 0.5), 0};
    s.frame.people.push_back(child);
    for (Person& p : s.frame.people) p.last_seen = t;
    if (fallen)
      s.frame.events.push_back(
          {EventKind::kFall, 3, 60, "went from standing to lying within 0.7 s, head at 0.21 m"});
  }
  void count(Snapshot& s) {
    Occupancy& o = s.occupancy;
    o = {};
    o.count = static_cast<std::uint32_t>(s.frame.people.size());
    o.observed_share = 0.93;
    for (const PlanZone& zone : unit_.plan.zones) {
      ZoneOccupancy z{zone.name, 0, zone.capacity, 0.93};
      for (const Person& p : s.frame.people)
        if (p.position[0] >= zone.polygon[0][0] && p.position[0] < zone.polygon[1][0]) ++z.count;
      o.zones.push_back(z);
    }
    for (std::size_t i = 0; i < unit_.plan.seats.size(); ++i) {
      const bool taken = i == 1 || i == 8;
      o.seats.push_back({unit_.plan.seats[i].name,
                         taken    ? Occupied::kOccupied
                         : i == 4 ? Occupied::kUnobserved
                                  : Occupied::kFree,
                         taken ? (i == 1 ? 2U : 5U) : 0});
    }
    o.doors.push_back({"door A", 6, 2});
    o.doors.push_back({"door B", 3, 2});
  }
  void tell_sensors(Snapshot& s, double t) {
    s.frame.skews.clear();
    double offset = 0;
    for (SensorStatus& sensor : s.sensors) {
      offset += 3.7;
      if (sensor.state == SensorState::kLost) {
        sensor.fps = 0;
        continue;
      }
      sensor.frames = static_cast<std::uint64_t>(t * 30);
      sensor.fps = 30 + 0.2 * std::sin(t + offset);
      sensor.skew_ms = 8 * std::sin(t / 20 + offset);
      sensor.latency_ms = 17 + std::sin(t + offset);
      sensor.last_good = t - 0.02;
      s.frame.skews.push_back({sensor.name, sensor.skew_ms});
    }
    double budget = 0.4;
    for (StageTiming& stage : s.stages) {
      budget += 0.9;
      stage.last_ms = budget * (1 + 0.2 * std::sin(t * budget));
      stage.p50_ms = budget;
      stage.p99_ms = budget * 1.6;
    }
  }

  const UnitInfo& unit_;
  std::unique_ptr<Snapshot> snapshot_;
};

int run(std::uint16_t port) {
  const auto listening = listen_on("127.0.0.1", port);
  const auto unit = std::make_unique<UnitInfo>(make_unit());
  auto shared = SharedBlockWriter::create(*unit);
  if (!listening || !shared) return 1;
  AccessRules access;
  if (const char* token = std::getenv("WAGONSIGHT_FEED_TOKEN")) access.read_token = token;
  auto log = std::make_unique<LogTail>();
  WebSupervisor web(shared->fd(), listening->fd, access, [&](std::string_view text) {
    std::fprintf(stderr, "%.*s\n", static_cast<int>(text.size()), text.data());
    if (!log->lines.full()) log->lines.push_back({0, 0, Severity::kWarning, text});
    shared->block().log.store(*log);
  });
  const double start = monotonic_seconds();
  Feed feed(*unit);
  shared->block().snapshot.store(feed.at(1.0));
  if (!web.start(start)) return 1;
  std::printf("http://127.0.0.1:%d/\n", static_cast<int>(listening->port));
  std::fflush(stdout);

  fcntl(STDIN_FILENO, F_SETFL, O_NONBLOCK);
  bool paused = false;
  std::string pending;
  for (;;) {
    char text[256];
    const ssize_t size = read(STDIN_FILENO, text, sizeof text);
    if (size == 0) return 0;  // whoever started us went
    if (size > 0) pending.append(text, static_cast<std::size_t>(size));
    for (std::size_t end = 0; (end = pending.find('\n')) != std::string::npos;) {
      const std::string line = pending.substr(0, end);
      pending.erase(0, end + 1);
      if (line == "quit") return 0;
      if (line == "pause" || line == "resume") paused = line == "pause";
      if (line == "fall" || line == "rise") feed.fallen = line == "fall";
      if (line == "kill") kill(web.pid(), SIGKILL);
      if (auto* s = feed.sensor(line.substr(std::min<std::size_t>(5, line.size()))))
        s->state = line.starts_with("lose") ? SensorState::kLost : SensorState::kOk;
    }
    const double now = monotonic_seconds();
    if (!paused) shared->block().snapshot.store(feed.at(60 + now - start));
    web.tick(now);
    std::this_thread::sleep_for(std::chrono::milliseconds(33));
  }
}

}  // namespace
}  // namespace wagonsight

int main(int argc, char** argv) {
  if (argc == 2 && std::strcmp(argv[1], wagonsight::kWebSideArgument) == 0)
    return wagonsight::run_web_side();
  return wagonsight::run(argc == 2 ? static_cast<std::uint16_t>(std::stoi(argv[1])) : 0);
}
