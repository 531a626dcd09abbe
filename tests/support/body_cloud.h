#pragma once

#include <cmath>

#include "fusion/fused_cloud.h"

// Stand-ins for people as clouds: a head, a torso and two legs, as seen by one sensor in the
// distance or from all around. Rough on purpose; nothing here is shared with the detector.
namespace wagonsight::testing {

struct SeenFrom {
  bool all_around = true;
  double sensor_x = 0, sensor_y = 0;  // on the floor, when not from all around
};

inline void add_point(FusedCloud& cloud, double x, double y, double z, const SeenFrom& from) {
  FusedPoint point;
  point.x = static_cast<float>(x);
  point.y = static_cast<float>(y);
  point.z = static_cast<float>(z);
  point.sigma = 0.01F;
  point.area_m2 = 4e-4F;
  if (!from.all_around) {
    const double length = std::hypot(x - from.sensor_x, y - from.sensor_y);
    point.away_x = static_cast<float>((x - from.sensor_x) / length);
    point.away_y = static_cast<float>((y - from.sensor_y) / length);
  }
  point.sensors = 1;
  const auto index = static_cast<std::uint32_t>(cloud.points.size());
  if (!cloud.points.try_push_back(point)) return;
  (void)cloud.contributions.try_push_back({index, 3.0F, 4, 300, 200, 0, 0});
}

// An upright elliptical column, closed on top when it is seen from all around.
inline void add_column(FusedCloud& cloud, double x, double y, double low, double high,
                       double half_wide, double half_deep, const SeenFrom& from) {
  const double step = 0.02;
  for (double angle = 0; angle < 6.283; angle += step / std::max(half_wide, half_deep)) {
    const double dx = half_deep * std::cos(angle);
    const double dy = half_wide * std::sin(angle);
    // Only the half that is turned to the sensor is seen.
    if (!from.all_around && dx * (x - from.sensor_x) + dy * (y - from.sensor_y) > 0) continue;
    for (double z = low; z < high; z += step) add_point(cloud, x + dx, y + dy, z, from);
  }
  if (!from.all_around) return;
  for (double dx = -half_deep; dx <= half_deep; dx += step)
    for (double dy = -half_wide; dy <= half_wide; dy += step)
      if (std::pow(dx / half_deep, 2) + std::pow(dy / half_wide, 2) < 1)
        add_point(cloud, x + dx, y + dy, high, from);
}

inline void add_person(FusedCloud& cloud, double x, double y, double height,
                       const SeenFrom& from = {}) {
  const double s = height / 1.75;
  add_column(cloud, x, y, height - 0.24 * s, height, 0.08 * s, 0.10 * s, from);
  add_column(cloud, x, y, height - 0.90 * s, height - 0.28 * s, 0.22 * s, 0.12 * s, from);
  add_column(cloud, x, y - 0.1 * s, 0.05, height - 0.90 * s, 0.07 * s, 0.07 * s, from);
  add_column(cloud, x, y + 0.1 * s, 0.05, height - 0.90 * s, 0.07 * s, 0.07 * s, from);
}

inline Bounds room() {
  return {{0, 0, 0}, {6, 4, 2.4}};
}

}  // namespace wagonsight::testing
