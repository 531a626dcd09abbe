#include "drift/drift_monitor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace wagonsight {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr double kScaleTold = 0.003;  // a Kinect that warms up changes by up to 1%

std::string describe_motion(const SensorDrift& sensor) {
  if (sensor.looks_elsewhere()) return "it looks elsewhere now";
  const SensorMotion& m = sensor.motion();
  const Eigen::Vector3d mm = m.shift_m * 1e3;
  return fmt::format(
      "by {:.0f} mm (right {:+.0f}, down {:+.0f}, forward {:+.0f}) and {:.2f} degrees", mm.norm(),
      mm.x(), mm.y(), mm.z(), m.turn_rad.norm() * kDegrees);
}

}  // namespace

DriftMonitor::DriftMonitor(const Rig& rig, const std::array<RayTable, kSensorsMax>& rays,
                           const StaticModel& model, const DriftOptions& options)
    : blob_sha256_(model.blob_sha256) {
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) {
    const RigSensor& sensor = rig.sensors[i];
    const auto view = std::find_if(model.views.begin(), model.views.end(),
                                   [&](const StaticModel::View& candidate) {
                                     return candidate.sensor == sensor.name.view() &&
                                            candidate.grid.width == sensor.camera.width &&
                                            candidate.grid.height == sensor.camera.height;
                                   });
    names_.push_back(sensor.name);
    sensors_.push_back(std::make_unique<SensorDrift>(
        sensor, rays[i],
        view == model.views.end() ? std::span<const float>() : std::span(view->depth_m), options));
  }
}

StaticModel DriftMonitor::model() const {
  StaticModel model;
  model.blob_sha256 = blob_sha256_;
  for (std::size_t i = 0; i < sensors_.size(); ++i) {
    const auto depth = sensors_[i]->depth_m();
    model.views.push_back({names_[i], sensors_[i]->grid(), {depth.begin(), depth.end()}});
  }
  return model;
}

bool DriftMonitor::alarm() const {
  return std::any_of(sensors_.begin(), sensors_.end(), [](const auto& sensor) {
    return sensor->state() == SensorDrift::State::kMoved;
  });
}

std::string DriftMonitor::text() const {
  std::string text;
  const auto say = [&](const std::string& sentence) {
    if (!text.empty()) text += "; ";
    text += sentence;
  };
  for (std::size_t i = 0; i < sensors_.size(); ++i)
    if (sensors_[i]->state() == SensorDrift::State::kMoved)
      say(fmt::format("{} {}", names_[i].view(), describe_motion(*sensors_[i])));
  const auto learning = std::count_if(sensors_.begin(), sensors_.end(), [](const auto& sensor) {
    return sensor->state() == SensorDrift::State::kLearning;
  });
  if (learning > 0)
    say(fmt::format("{} sensor{} the empty wagon", learning, learning > 1 ? "s learn" : " learns"));
  for (std::size_t i = 0; i < sensors_.size(); ++i) {
    const SensorDrift& sensor = *sensors_[i];
    const SensorMotion& motion = sensor.motion();
    if (!motion.known) continue;
    const double change = 1 / motion.scale - 1;
    if (std::abs(change) > kScaleTold)
      say(fmt::format("{} measures depths {:.1f}% {} than at calibration", names_[i].view(),
                      std::abs(change) * 100, change > 0 ? "longer" : "shorter"));
    if (!motion.vague.empty()) {
      std::string list = motion.vague.front();
      for (std::size_t k = 1; k < motion.vague.size(); ++k) list += ", " + motion.vague[k];
      say(fmt::format("{} cannot tell: {}", names_[i].view(), list));
    }
  }
  return text;
}

}  // namespace wagonsight
