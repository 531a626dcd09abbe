// Shows what the drift monitor sees: drift_study [--hours H] [--trials N] SCENE.toml [PART.toml..]
// One camera is moved by so much while the wagon is occupied (the monitor is not told of the
// passengers), and how long it takes to the alarm; then H hours in which nothing moves. Prints a
// table and fails when a limit is missed: every move of a Kinect by 1 cm or 0.3 degrees and more is
// told within a minute, no warm-up and nothing that stands still is; half a centimetre may be told,
// as a measurement is off by 2 to 3 mm. A stereo camera measures with a sigma of 2 to 5 mm: twice
// the move must be told.
#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <numbers>
#include <sstream>

#include "drift/drift_monitor.h"
#include "geometry/angles.h"
#include "simulate/room.h"
#include "simulate/simulation.h"
#include "stereo/rectify.h"
#include "stereo/stereo_to_depth.h"

namespace wagonsight {
namespace {

constexpr double kPeriod = 0.5;       // seconds between samples
constexpr double kPatience = 60;      // seconds a move may take to be told
constexpr double kOccupiedFrom = 70;  // seconds into the scene: people sit, stand and walk
constexpr double kDegrees = 180 / std::numbers::pi;

// A stereo camera's eyes: pairs under the exposure law, matched whole.
class MatchedPairs {
 public:
  MatchedPairs(const Scene& scene, std::size_t sensor, std::uint64_t seed)
      : model_(scene, sensor, seed),
        to_depth_(*make_rectification(model_.imagers().left, model_.imagers().right,
                                      model_.imagers().X_LR)),
        workspace_(std::move(*StereoWorkspace::create(model_.width(), model_.height(), {}))),
        pair_(2 * static_cast<std::size_t>(model_.width() * model_.height())) {}

  DepthImage next(World& world, HostTime instant, std::uint32_t number) {
    model_.render(world, instant, number, exposure_, pair_);
    FrameSlot slot;
    slot.instant = instant;
    slot.format = PixelFormat::kGray16;
    slot.width = model_.width();
    slot.height = model_.height();
    slot.exposure = exposure_;
    slot.bytes = std::as_writable_bytes(std::span(pair_));
    const DepthImage depth = to_depth_.convert(slot, true, {}, *workspace_);
    exposure_ = to_depth_.report().next;
    return depth;
  }

 private:
  StereoModel model_;
  StereoToDepth to_depth_;
  std::unique_ptr<StereoWorkspace> workspace_;
  std::vector<std::uint16_t> pair_;
  Exposure exposure_ = StereoModel::kFirstExposure;
};

// One sensor's depths at two a second, from any second of the scene on.
class Camera2Hz {
 public:
  Camera2Hz(const Scene& scene, std::size_t sensor, std::uint64_t seed, double from_s)
      : scene_(scene), world_(scene_, seed), seconds_(from_s) {
    const Camera camera = rig_of(scene_).sensors[sensor].camera;
    if (rig_of(scene_).sensors[sensor].kind == SensorKind::kStereo) {
      pairs_ = std::make_unique<MatchedPairs>(scene_, sensor, seed);
    } else {
      kinect_ = std::make_unique<KinectModel>(scene_, sensor, seed);
    }
    grid_ = {camera.width, camera.height};
    pixels_.resize(static_cast<std::size_t>(grid_.width * grid_.height));
    readings_.resize(grid_.size());
  }
  // `scale` on what the sensor measures, as a warm-up does.
  std::span<const std::uint16_t> next(double scale = 1) {
    const HostTime instant(from_seconds(seconds_));
    DepthImage depth{pixels_.data(), grid_.width, grid_.height};
    if (pairs_ != nullptr) {
      depth = pairs_->next(world_, instant, ++number_);
    } else {
      kinect_->render(world_, instant, ++number_, pixels_);
    }
    seconds_ += kPeriod;
    std::fill(readings_.begin(), readings_.end(), std::uint16_t{0});
    if (depth.pixels != nullptr) sample(grid_, depth, readings_);
    if (scale != 1)
      for (std::uint16_t& reading : readings_)
        reading = static_cast<std::uint16_t>(std::lround(reading * scale));
    return readings_;
  }

 private:
  Scene scene_;
  World world_;
  std::unique_ptr<KinectModel> kinect_;
  std::unique_ptr<MatchedPairs> pairs_;
  DepthGrid grid_;
  std::vector<std::uint16_t> pixels_, readings_;
  double seconds_;
  std::uint32_t number_ = 0;
};

struct Move {
  const char* name;
  double shift_m = 0, turn_deg = 0, scale = 1;
  bool must_alarm = false, must_not = false;  // of a Kinect
  bool must_alarm_stereo = must_alarm;
};

struct Study {
  Scene scene, empty;
  Rig rig;
  std::vector<std::vector<PixelRay>> rays;
  std::vector<std::vector<float>> learned;  // by sensor

  explicit Study(const Scene& the_scene)
      : scene(the_scene), empty(the_scene), rig(rig_of(the_scene)) {
    empty.passengers.clear();
    for (std::size_t i = 0; i < rig.sensors.size(); ++i) {
      rays.push_back(make_ray_table(rig.sensors[i].camera));
      SensorDrift drift(rig.sensors[i], rays[i], {}, DriftOptions());
      Camera2Hz camera(empty, i, 11, 0);
      while (drift.state() == SensorDrift::State::kLearning) drift.add(camera.next(), {});
      learned.emplace_back(drift.depth_m().begin(), drift.depth_m().end());
    }
  }
  SensorDrift watcher(std::size_t sensor) const {
    return {rig.sensors[sensor], rays[sensor], learned[sensor], DriftOptions()};
  }
  // The scene with one sensor moved along its axis 0 to 2, or turned about its axis 0 or 1.
  Scene moved(std::size_t sensor, const Move& move, int axis) const {
    Scene changed = scene;
    SceneSensor& s = changed.sensors[sensor];
    const Eigen::Matrix3d R = rig.sensors[sensor].X_WS.rotation.toRotationMatrix();
    const Eigen::Vector3d by = move.shift_m * R.col(axis);
    const Eigen::AngleAxisd turn(move.turn_deg / kDegrees, R.col(axis % 2));
    s.look_at = s.position + by + turn * (s.look_at - s.position);
    s.position += by;
    return changed;
  }
};

struct Tally {
  int trials = 0, alarms = 0;
  double seconds = 0, slowest = 0, shift_mm = 0, turn_deg = 0, scale = 0;
};

void try_one(const Study& study, const Move& move, std::size_t sensor, int axis, Tally& tally) {
  Camera2Hz camera(study.moved(sensor, move, axis), sensor, 100 + static_cast<unsigned>(axis),
                   kOccupiedFrom);
  SensorDrift drift = study.watcher(sensor);
  double seconds = 0;
  while (seconds < kPatience && drift.state() != SensorDrift::State::kMoved) {
    drift.add(camera.next(move.scale), {});
    seconds += kPeriod;
  }
  ++tally.trials;
  if (drift.state() == SensorDrift::State::kMoved) {
    ++tally.alarms;
    tally.seconds += seconds;
    tally.slowest = std::max(tally.slowest, seconds);
  }
  const SensorMotion& motion = drift.motion();
  tally.shift_mm += motion.shift_m.norm() * 1e3;
  tally.turn_deg += motion.turn_rad.norm() * kDegrees;
  tally.scale += (1 / motion.scale - 1) * 100;
}

// False when the row is not as it must be.
bool try_all(const Study& study, SensorKind kind, const Move& move, int trials) {
  Tally tally;
  const int axes = move.turn_deg > 0 ? 2 : 3;
  for (std::size_t sensor = 0; sensor < study.rig.sensors.size(); ++sensor)
    for (int axis = 0; axis < axes && tally.trials < trials; ++axis)
      if (study.rig.sensors[sensor].kind == kind) try_one(study, move, sensor, axis, tally);
  const double n = tally.trials;
  if (tally.trials == 0) return true;
  fmt::print(
      "| {} | {} | {} of {} | {} | {:.1f} mm, {:.2f} degrees, {:+.2f}% |\n",
      kind == SensorKind::kStereo ? "stereo" : "Kinect", move.name, tally.alarms, tally.trials,
      tally.alarms > 0
          ? fmt::format("{:.0f} s, {:.0f} s at most", tally.seconds / tally.alarms, tally.slowest)
          : "-",
      tally.shift_mm / n, tally.turn_deg / n, tally.scale / n);
  std::fflush(stdout);
  const bool is_stereo = kind == SensorKind::kStereo;
  const bool must_alarm = is_stereo ? move.must_alarm_stereo : move.must_alarm;
  return !(must_alarm && tally.alarms < tally.trials) && !(move.must_not && tally.alarms > 0);
}

// The hours are shared by the sensors; each begins at another place of the scene.
int false_alarms(const Study& study, double hours, int& judgements) {
  int alarms = 0;
  const double each_s = 3600 * hours / static_cast<double>(study.rig.sensors.size());
  for (std::size_t sensor = 0; sensor < study.rig.sensors.size(); ++sensor) {
    Camera2Hz camera(study.scene, sensor, 500 + sensor, 17.0 * static_cast<double>(sensor));
    SensorDrift drift = study.watcher(sensor);
    bool told = false;
    for (double seconds = 0; seconds < each_s; seconds += kPeriod) {
      drift.add(camera.next(), {});
      const bool moved = drift.state() == SensorDrift::State::kMoved;
      if (moved && !told)
        ++alarms, fmt::print("{} false after {:.0f} s: {:.1f} mm, {:.2f} degrees\n",
                             study.rig.sensors[sensor].name.view(), seconds,
                             drift.motion().shift_m.norm() * 1e3,
                             drift.motion().turn_rad.norm() * kDegrees);
      told = moved;
    }
    judgements += drift.judgements();
    for (const std::string& vague : drift.motion().vague)
      fmt::print("{} cannot tell: {}\n", study.rig.sensors[sensor].name.view(), vague);
  }
  return alarms;
}

int run(const std::vector<const char*>& paths, double hours, int trials) {
  std::stringstream text;
  for (const char* path : paths) text << std::ifstream(path).rdbuf() << "\n";
  const auto scene = parse_scene(text.str(), paths.front());
  if (!scene) {
    fmt::print(stderr, "{}\n", scene.error().message);
    return 1;
  }
  const Study study(*scene);
  constexpr Move kMoves[] = {{"not moved", 0, 0, 1, false, true},
                             {"0.5 cm", 0.005},
                             {"1 cm", 0.01, 0, 1, true, false, false},
                             {"2 cm", 0.02, 0, 1, true, false},
                             {"0.1 degrees", 0, 0.1, 1, false, true},
                             {"0.3 degrees", 0, 0.3, 1, true, false, false},
                             {"0.6 degrees", 0, 0.6, 1, true, false},
                             {"warm-up, depths 1% longer", 0, 0, 1.01, false, true}};
  fmt::print(
      "| one camera | moved by | alarms | time to alarm | measured, mean: shift, turn, depth scale "
      "|\n|---|---|---|---|---|\n");
  bool good = true;
  for (const SensorKind kind : {SensorKind::kKinect, SensorKind::kStereo})
    for (const Move& move : kMoves) good = try_all(study, kind, move, trials) && good;
  int judgements = 0;
  const int alarms = false_alarms(study, hours, judgements);
  fmt::print("{} false alarms in {} sensor hours, {} judgements\n", alarms, hours, judgements);
  return good && alarms == 0 ? 0 : 1;
}

}  // namespace
}  // namespace wagonsight

int main(int argc, char** argv) {
  double hours = 0.25;
  int trials = 12;
  std::vector<const char*> paths;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--hours") == 0 && i + 1 < argc)
      hours = std::atof(argv[++i]);
    else if (std::strcmp(argv[i], "--trials") == 0 && i + 1 < argc)
      trials = std::atoi(argv[++i]);
    else
      paths.push_back(argv[i]);
  }
  if (paths.empty()) {
    std::fputs("drift_study [--hours H] [--trials N] SCENE.toml [PART.toml..]\n", stderr);
    return 2;
  }
  return wagonsight::run(paths, hours, trials);
}
