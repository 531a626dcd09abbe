#pragma once

#include <cmath>
#include <vector>

#include "frame/frame.h"
#include "geometry/angles.h"
#include "rig/ray_table.h"
#include "rig/rig.h"
#include "wagon/wagon.h"

// A room of 6 x 4 x 2.4 m drawn into depth images by a few lines of ray casting: floor, walls and
// upright columns that stand for people. Without noise; half the Kinect's resolution.
namespace wagonsight::testing {

struct Column {
  double x, y, top, radius;
};
// A torso with a head on it.
inline std::vector<Column> drawn_person(double x, double y, double height) {
  return {{x, y, height - 0.26, 0.19}, {x, y, height, 0.09}};
}

inline Wagon drawn_wagon() {
  Wagon wagon;
  wagon.inside = {{0, 0, 0}, {6, 4, 2.4}};
  return wagon;
}

inline RigSensor drawn_sensor(const char* name, const Eigen::Vector3d& position,
                              const Eigen::Vector3d& target) {
  RigSensor sensor;
  sensor.name = name;
  sensor.camera = {320, 240, 290, 290, 159.5, 119.5, {}};
  sensor.X_WS = {look_at(position, target), position};
  sensor.trim_far = 8;
  return sensor;
}

// Distance along the ray o + t d to the nearest surface.
inline double drawn_depth(const Eigen::Vector3d& o, const Eigen::Vector3d& d,
                          const std::vector<Column>& columns) {
  double nearest = 1e9;
  const auto take = [&](double t) {
    if (t > 1e-6 && t < nearest) nearest = t;
  };
  if (d.z() < 0) take(-o.z() / d.z());
  const double walls[2] = {6, 4};
  for (int axis = 0; axis < 2; ++axis)
    take(((d[axis] > 0 ? walls[axis] : 0.0) - o[axis]) / d[axis]);
  for (const Column& c : columns) {
    const double dx = o.x() - c.x;
    const double dy = o.y() - c.y;
    const double a = d.x() * d.x() + d.y() * d.y();
    const double b = dx * d.x() + dy * d.y();
    const double q = b * b - a * (dx * dx + dy * dy - c.radius * c.radius);
    if (q > 0) {
      const double t = (-b - std::sqrt(q)) / a;
      if (o.z() + t * d.z() < c.top) take(t);
    }
    if (d.z() < 0) {  // its lid
      const double t = (c.top - o.z()) / d.z();
      if (std::hypot(dx + t * d.x(), dy + t * d.y()) < c.radius) take(t);
    }
  }
  return nearest;
}

// Millimetres, 0 beyond 8 m.
inline void draw(const RigSensor& sensor, const std::vector<Column>& columns,
                 std::vector<std::uint16_t>& pixels) {
  const Camera& camera = sensor.camera;
  pixels.resize(static_cast<std::size_t>(camera.width * camera.height));
  for (int v = 0; v < camera.height; ++v)
    for (int u = 0; u < camera.width; ++u) {
      const Eigen::Vector3d ray((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1);
      const double z = drawn_depth(sensor.X_WS.position, sensor.X_WS.rotation * ray, columns);
      pixels[static_cast<std::size_t>(v * camera.width + u)] =
          z < 8 ? static_cast<std::uint16_t>(std::lround(1000 * z)) : 0;
    }
}

}  // namespace wagonsight::testing
