#include "rig/rig.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

// Bounds far outside of what any real rig has: they catch a wrong unit or a broken file, nothing
// finer.
constexpr double kPositionMax_m = 1000;  // W, B and S are all in or near one wagon
constexpr double kDistortionMax = 100;   // k3 of a strong wide angle lens reaches a few tens
constexpr double kUnitNormTolerance = 1e-6;
constexpr double kTrimMax_m = 65.535;  // the largest 16-bit depth
constexpr double kRateMax_hz = 1000;
constexpr std::int64_t kYear3000Unix = 32'503'680'000;

// Collects the first rule that is broken, with the value that breaks it.
class Rules {
 public:
  explicit Rules(std::string_view subject) : subject_(subject) {}

  void require_between(const char* what, double value, double low, double high) {
    if (!broken_.empty() || (value >= low && value <= high)) return;  // NaN is not between
    broken_ =
        fmt::format("{}: {} is {}, but must be from {} to {}", subject_, what, value, low, high);
  }
  void require(bool holds, std::string_view rule) {
    if (broken_.empty() && !holds) broken_ = fmt::format("{}: {}", subject_, rule);
  }
  void require_rigid(const char* what, const Eigen::Quaterniond& rotation,
                     const Eigen::Vector3d& position) {
    require_between(fmt::format("the norm of {}'s rotation", what).c_str(), rotation.norm(),
                    1 - kUnitNormTolerance, 1 + kUnitNormTolerance);
    for (int axis = 0; axis < 3; ++axis)
      require_between(fmt::format("{}'s {}", what, "xyz"[axis]).c_str(), position[axis],
                      -kPositionMax_m, kPositionMax_m);
  }
  template <class Matrix>
  void require_covariance(const Matrix& covariance) {
    require(covariance.allFinite(), "its covariance is not a number");
    require((covariance.diagonal().array() >= 0).all(), "its covariance has a negative variance");
    const double asymmetry = (covariance - covariance.transpose()).cwiseAbs().maxCoeff();
    require(asymmetry <= 1e-9 * (1 + covariance.cwiseAbs().maxCoeff()),
            "its covariance is not symmetric");
  }
  std::string take() { return std::move(broken_); }

 private:
  std::string_view subject_;
  std::string broken_;
};

void check_camera(const Camera& camera, Rules& rules) {
  constexpr double kSideMax = 65'535;
  rules.require_between("width", camera.width, 1, kSideMax);
  rules.require_between("height", camera.height, 1, kSideMax);
  rules.require_between("width times height", static_cast<double>(camera.width) * camera.height, 1,
                        static_cast<double>(kImagePixelsMax));
  // From a fisheye's 150 degrees to a telescope's 3.
  const double side = std::max(camera.width, camera.height);
  rules.require_between("fx", camera.fx, 0.1 * side, 20 * side);
  rules.require_between("fy", camera.fy, 0.1 * side, 20 * side);
  rules.require_between("cx", camera.cx, -camera.width, 2.0 * camera.width);
  rules.require_between("cy", camera.cy, -camera.height, 2.0 * camera.height);
  for (const double k : camera.distortion)
    rules.require_between("a distortion coefficient", k, -kDistortionMax, kDistortionMax);
}

void check_noise(const RigSensor& sensor, Rules& rules) {
  const DepthNoise& noise = sensor.noise;
  for (const double term : {noise.a, noise.b, noise.c})
    rules.require_between("a term of the depth noise", term, -1, 1);
  rules.require_between("quantisation_per_z2", noise.quantisation_per_z2, 0, 1);
  // A parabola is lowest at one end of the range or at its vertex.
  double lowest = std::min(noise.sigma(sensor.trim_near), noise.sigma(sensor.trim_far));
  if (noise.c > 0) {
    const double vertex = std::clamp(-noise.b / (2 * noise.c), sensor.trim_near, sensor.trim_far);
    lowest = std::min(lowest, noise.sigma(vertex));
  }
  rules.require(lowest > 0, "its depth noise is not above zero everywhere between its trims");
}

std::string broken_rule(const RigSensor& sensor) {
  Rules rules(sensor.name.view());
  rules.require(is_sensor_name(sensor.name), "a sensor's name must be of letters, digits, _ and -");
  rules.require(sensor.kind == SensorKind::kKinect || sensor.kind == SensorKind::kStereo,
                "its kind is neither kinect nor stereo");
  check_camera(sensor.camera, rules);
  rules.require_rigid("X_BS", sensor.X_BS.rotation, sensor.X_BS.position);
  rules.require_rigid("X_WS", sensor.X_WS.rotation, sensor.X_WS.position);
  const double baseline_min = sensor.kind == SensorKind::kStereo ? 1e-3 : 0;
  rules.require_between("baseline", sensor.stereo.baseline, baseline_min, 10);
  if (sensor.stereo.has_lenses()) {
    check_camera(sensor.stereo.left, rules);
    check_camera(sensor.stereo.right, rules);
    rules.require_rigid("X_LR", sensor.stereo.X_LR.rotation, sensor.stereo.X_LR.position);
  }
  rules.require_between("trim_near", sensor.trim_near, 0, kTrimMax_m);
  rules.require_between("trim_far", sensor.trim_far, 0, kTrimMax_m);
  rules.require(sensor.trim_near < sensor.trim_far, "trim_near must be below trim_far");
  check_noise(sensor, rules);
  rules.require_between("rate_hz", sensor.rate_hz, 1e-3, kRateMax_hz);
  rules.require_between("depth_scale", sensor.depth_scale, 0.5, 2);
  rules.require_between("depth_offset", sensor.depth_offset, -1, 1);
  constexpr double kStampDelayMax_s = 0.5;  // half a second is no latency but another fault
  rules.require_between("stamp_delay", sensor.stamp_delay.delay_s, -kStampDelayMax_s,
                        kStampDelayMax_s);
  rules.require_between("stamp_delay's sigma", sensor.stamp_delay.sigma_s, 0, kStampDelayMax_s);
  rules.require_between("rms_px", sensor.rms_px, 0, 1000);
  rules.require_covariance(sensor.covariance);
  return rules.take();
}

std::string broken_rule(const Georeference& georeference) {
  Rules rules("georeference");
  rules.require_rigid("X_WB", georeference.X_WB.rotation, georeference.X_WB.position);
  rules.require_between("scale", georeference.X_WB.scale, 0.1, 10);
  rules.require_between("rms_m", georeference.rms_m, 0, kPositionMax_m);
  rules.require_covariance(georeference.covariance);
  return rules.take();
}

}  // namespace

int find_sensor(const Rig& rig, std::string_view name) {
  for (std::size_t i = 0; i < rig.sensors.size(); ++i)
    if (rig.sensors[i].name == name) return static_cast<int>(i);
  return -1;
}

std::array<Duration, kSensorsMax> stamp_delays(const Rig& rig) {
  std::array<Duration, kSensorsMax> delays{};
  for (std::size_t i = 0; i < rig.sensors.size(); ++i)
    delays[i] = from_seconds(rig.sensors[i].stamp_delay.delay_s);
  return delays;
}

bool is_sensor_name(std::string_view name) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-';
  };
  return !name.empty() && name.size() <= Name::capacity() &&
         std::all_of(name.begin(), name.end(), allowed);
}

Result<void> check_rig(const Rig& rig) {
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) {
    if (auto broken = broken_rule(rig.sensors[i]); !broken.empty()) return fail(std::move(broken));
    const std::string_view name = rig.sensors[i].name;
    if (find_sensor(rig, name) != static_cast<int>(i))
      return fail(fmt::format("{}: two sensors have this name", name));
  }
  if (auto broken = broken_rule(rig.georeference); !broken.empty()) return fail(std::move(broken));
  if (rig.provenance.created_unix < 0 || rig.provenance.created_unix > kYear3000Unix)
    return fail(fmt::format("provenance: created_unix is {}, but must be from 0 to {}",
                            rig.provenance.created_unix, kYear3000Unix));
  return {};
}

}  // namespace wagonsight
