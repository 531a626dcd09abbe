#include "simulate/wagon_light.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace wagonsight {
namespace {

constexpr double kRamp_s = 0.5;
constexpr double kSwing = 12 * std::numbers::pi / 180, kSwing_s = 40;
constexpr double kSunStepsPerS = 2;

struct Levels {
  float lamps, day, sun, outside;
};

// Lamps stay on; a tunnel takes four fifths of the light away.
Levels levels_of(LightState state) {
  switch (state) {
    case LightState::kDay:
      return {0.12F, 0.50F, 0, 2.5F};
    case LightState::kTunnel:
      return {0.12F, 0, 0, 0.005F};
    case LightState::kSun:
      return {0.12F, 0.60F, 2.5F, 4.0F};
  }
  return {0.12F, 0.50F, 0, 2.5F};
}

}  // namespace

WagonLight light_of(const Scene& scene, double seconds) {
  const double time = time_in(scene, seconds);
  LightState before = LightState::kDay, now = LightState::kDay;
  double since = 1e9;
  Eigen::Vector3d direction = SceneLight{}.direction;
  for (const SceneLight& light : scene.lights) {
    if (light.at > time) break;
    before = now;
    now = light.state;
    since = light.at > 0 ? time - light.at : 1e9;  // how a scene begins it has always been
    if (light.state == LightState::kSun) direction = light.direction;
  }
  const auto share = static_cast<float>(std::clamp(since / kRamp_s, 0.0, 1.0));
  const Levels a = levels_of(before), b = levels_of(now);
  WagonLight light;
  light.lamps = a.lamps + share * (b.lamps - a.lamps);
  light.day = a.day + share * (b.day - a.day);
  light.sun = a.sun + share * (b.sun - a.sun);
  light.outside = a.outside + share * (b.outside - a.outside);
  light.seconds = seconds;
  if (light.sun > 0) {
    light.sun_step = static_cast<std::int64_t>(seconds * kSunStepsPerS);
    const double when = static_cast<double>(light.sun_step) / kSunStepsPerS;
    const double turn = kSwing * std::sin(2 * std::numbers::pi * when / kSwing_s);
    light.to_sun =
        (Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()) * -direction).normalized().cast<float>();
  }
  return light;
}

SunPatches::SunPatches(const std::vector<SceneBox>& windows) {
  for (const SceneBox& window : windows) {
    Pane pane;
    const Eigen::Vector3d size = window.max - window.min;
    size.minCoeff(&pane.axis);
    pane.first = pane.axis == 0 ? 1 : 0;
    pane.second = pane.axis == 2 ? 1 : 2;
    pane.plane = static_cast<float>((window.min[pane.axis] + window.max[pane.axis]) / 2);
    for (int i = 0; i < 2; ++i) {
      const int along = i == 0 ? pane.first : pane.second;
      pane.low[i] = static_cast<float>(window.min[along]);
      pane.high[i] = static_cast<float>(window.max[along]);
    }
    panes_.push_back(pane);
  }
}

void SunPatches::set(const WagonLight& light) {
  shining_ = light.sun > 0;
  to_sun_ = light.to_sun;
  for (Pane& pane : panes_) {
    const float along = to_sun_[pane.axis];
    pane.step = std::abs(along) > 1e-3F ? 1.0F / along : 0.0F;
  }
}

}  // namespace wagonsight
