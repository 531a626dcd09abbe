#include "simulate/kinect_optics.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "geometry/angles.h"
#include "simulate/noise_field.h"
#include "simulate/random.h"

namespace wagonsight {
namespace {

using Eigen::Vector3d;

std::size_t pixel_count(const Camera& camera) {
  return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
}

struct Drawn {
  std::vector<PreparedPart> parts;
  std::vector<float> inverse_depth;
  std::vector<std::int32_t> part;
};

Drawn draw_room(const Raster& raster, const std::vector<RoomPart>& room, const Rigid& X_SW) {
  Drawn drawn;
  const std::size_t count = pixel_count(raster.camera());
  drawn.inverse_depth.assign(count, 0);
  drawn.part.assign(count, -1);
  const RasterTarget target{raster.camera().width, raster.camera().height, drawn.inverse_depth,
                            drawn.part};
  for (const RoomPart& piece : room) {
    drawn.parts.push_back(raster.prepare(piece.part, X_SW));
    raster.draw(drawn.parts.back(), static_cast<std::int32_t>(drawn.parts.size() - 1), target);
  }
  return drawn;
}

// Whether the ray p + t d, t > 0, meets the box, and where first.
bool meets(const Vector3d& p, const Vector3d& d, const Vector3d& min, const Vector3d& max,
           double& first) {
  double enter = 1e-3, leave = 1e9;
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(d[axis]) < 1e-12) {
      if (p[axis] < min[axis] || p[axis] > max[axis]) return false;
      continue;
    }
    double a = (min[axis] - p[axis]) / d[axis], b = (max[axis] - p[axis]) / d[axis];
    if (a > b) std::swap(a, b);
    enter = std::max(enter, a);
    leave = std::min(leave, b);
  }
  first = enter;
  return enter <= leave;
}

// The distance to the first solid along a unit direction, or 0.
double cast(const std::vector<RoomPart>& room, const Vector3d& p, const Vector3d& d) {
  double nearest = 1e9;
  for (const RoomPart& piece : room) {
    const Eigen::Matrix3d to_local = piece.part.axes.transpose();
    double first = 0;
    if (meets(to_local * (p - piece.part.centre), to_local * d, -piece.part.half, piece.part.half,
              first))
      nearest = std::min(nearest, first);
  }
  return nearest < 1e8 ? nearest : 0;
}

}  // namespace

KinectOptics::KinectOptics(const Scene& scene, std::size_t sensor, std::uint64_t seed)
    : scene_(&scene),
      room_(room_of(scene)),
      raster_(kinect_camera()),
      X_WS_{look_at(scene.sensors[sensor].position, scene.sensors[sensor].look_at),
            scene.sensors[sensor].position},
      seed_(mixed(seed, 0x0971, sensor)) {
  for (std::size_t i = 0; i < scene.sensors.size(); ++i) {
    const SceneSensor& other = scene.sensors[i];
    if (i == sensor || other.kind != SensorKind::kKinect) continue;
    const Rigid X_WO{look_at(other.position, other.look_at), other.position};
    const Rigid X_OW = X_WO.inverse();
    others_.push_back({X_OW, draw_room(raster_, room_, X_OW).inverse_depth});
  }
  const Camera& camera = raster_.camera();
  luck_.resize(pixel_count(camera));
  NoiseField field(camera.width, camera.height, 0.2);
  field.draw(seed_);
  for (int v = 0; v < camera.height; ++v) {
    const auto row = field.row(v);
    std::copy(row.begin(), row.end(),
              luck_.begin() + static_cast<std::ptrdiff_t>(v) * camera.width);
  }
}

float KinectOptics::foreign_light(const Vector3d& p_W, double distance2) const {
  const Camera& camera = raster_.camera();
  double sum = 0;
  for (const OtherProjector& other : others_) {
    const Vector3d p = other.X_SW * p_W;
    if (p.z() < 0.4) continue;
    const double u = camera.fx * p.x() / p.z() + camera.cx;
    const double v = camera.fy * p.y() / p.z() + camera.cy;
    if (u < 0 || v < 0 || u > camera.width - 1 || v > camera.height - 1) continue;
    const auto pixel = static_cast<std::size_t>(v + 0.5) * static_cast<std::size_t>(camera.width) +
                       static_cast<std::size_t>(u + 0.5);
    const double blocked_at = static_cast<double>(other.inverse_depth[pixel]);
    constexpr double kBehind = 1.04;  // a surface does not shade itself
    if (blocked_at * p.z() > kBehind) continue;
    sum += distance2 / p.squaredNorm();
  }
  return static_cast<float>(std::min(sum, 20.0));
}

bool KinectOptics::sunlit(const Vector3d& p_W, const SceneLight& light) const {
  if (light.state != LightState::kSun) return false;
  const Vector3d to_sun = -light.direction;
  double at_pane = 0;
  const auto through = [&](const SceneBox& window) {
    return meets(p_W, to_sun, window.min.array() - 0.02, window.max.array() + 0.02, at_pane);
  };
  return std::any_of(scene_->windows.begin(), scene_->windows.end(), through);
}

void KinectOptics::read_pane(const PreparedPart& part, Material material, const SceneLight& light,
                             const Rigid& X_WS, int u, int v, float& w, float& score) const {
  const Vector3d d_S(static_cast<double>(raster_.ray_x(u)), static_cast<double>(raster_.ray_y(v)),
                     1);
  const float luck = luck_[static_cast<std::size_t>(v * raster_.camera().width + u)];
  if (material == Material::kScreen) {  // it shines by itself: patches of wrong depth, or none
    w *= 1.0F + 0.08F * luck;
    score = -0.4F + 1.2F * luck;
    return;
  }
  // Glass: by day there is nothing behind it that scatters the pattern back; in the dark it
  // mirrors the inside, which then seems to stand outside.
  const bool mirrors = light.state == LightState::kTunnel;
  score = mirrors ? 0.2F + luck : -2.6F + 0.8F * luck;
  if (!mirrors) return;
  const Vector3d d_W = (X_WS.rotation * d_S).normalized();
  const double depth = 1.0 / static_cast<double>(w);
  const Vector3d p_W = X_WS * Vector3d(d_S * depth);
  // The pane's normal is its thinnest direction: there m, the axis over the half size, is longest.
  int thin = 0;
  const auto steepness = [&part](int axis) {
    const auto& m = part.m[static_cast<std::size_t>(axis)];
    return m[0] * m[0] + m[1] * m[1] + m[2] * m[2];
  };
  for (int axis = 1; axis < 3; ++axis)
    if (steepness(axis) > steepness(thin)) thin = axis;
  Vector3d mirrored = d_W;
  mirrored[thin] = -mirrored[thin];
  const double beyond = cast(room_, p_W + 0.02 * mirrored, mirrored);
  if (beyond <= 0) return;
  const double stretch = 1 + beyond / (depth * d_S.norm());
  w = static_cast<float>(static_cast<double>(w) / stretch);
}

StillView KinectOptics::still_view(const Rigid& X_WS, const SceneLight& light) const {
  const Camera& camera = raster_.camera();
  const Drawn drawn = draw_room(raster_, room_, X_WS.inverse());
  StillView view;
  view.inverse_depth = drawn.inverse_depth;
  view.score.assign(pixel_count(camera), kNoReading);
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const std::size_t i = static_cast<std::size_t>(v) * static_cast<std::size_t>(camera.width) +
                            static_cast<std::size_t>(u);
      if (drawn.part[i] < 0) continue;
      const auto index = static_cast<std::size_t>(drawn.part[i]);
      const PreparedPart& part = drawn.parts[index];
      const Material material = room_[index].material;
      float& w = view.inverse_depth[i];
      float& score = view.score[i];
      const Vector3d d_S(static_cast<double>(raster_.ray_x(u)),
                         static_cast<double>(raster_.ray_y(v)), 1);
      const Vector3d p_W = X_WS * Vector3d(d_S / static_cast<double>(w));
      if (material == Material::kGlass || material == Material::kScreen) {
        read_pane(part, material, light, X_WS, u, v, w, score);
        continue;
      }
      score = surface_score(part.albedo, raster_.incidence(part, u, v, w), w) + kLuck * luck_[i] -
              foreign_penalty(foreign_light(p_W, (p_W - X_WS.position).squaredNorm()), luck_[i]);
      if (sunlit(p_W, light)) score = kNoReading;
    }
  }
  cast_projector_shadow(view.inverse_depth.data(), view.score.data(), camera.width, camera.width, 0,
                        camera.height);
  return view;
}

void cast_projector_shadow(const float* inverse_depth, float* score, int width, int stride,
                           int v_begin, int v_end) {
  constexpr float kFocalBaseline = 580.0F * 0.075F;
  constexpr float kSelf = 1.5F;  // pixels: a slanted surface does not shade itself
  for (int v = v_begin; v < v_end; ++v) {
    const float* w = inverse_depth + static_cast<std::ptrdiff_t>(v) * stride;
    float* s = score + static_cast<std::ptrdiff_t>(v) * stride;
    float leftmost = 1e9F;
    for (int u = width - 1; u >= 0; --u) {
      const float column = static_cast<float>(u) - kFocalBaseline * w[u];
      if (column > leftmost + kSelf) s[u] = kNoReading;
      leftmost = std::min(leftmost, column);
    }
  }
}

}  // namespace wagonsight
