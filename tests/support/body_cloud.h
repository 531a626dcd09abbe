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

inline void add_column(FusedCloud& cloud, double x, double y, double low, double high,
                       double half_wide, double half_deep, const SeenFrom& from) {
  const double step = 0.02;
  for (double z = low; z < high; z += step)
    for (double angle = 0; angle < 6.283; angle += step / std::max(half_wide, half_deep)) {
      const double dx = half_deep * std::cos(angle);
      const double dy = half_wide * std::sin(angle);
      const double away_x = x - from.sensor_x;
      const double away_y = y - from.sensor_y;
      const double length = std::hypot(away_x, away_y);
      // The half that is turned to the sensor.
      if (!from.all_around && dx * away_x + dy * away_y > 0) continue;
      FusedPoint point;
      point.x = static_cast<float>(x + dx);
      point.y = static_cast<float>(y + dy);
      point.z = static_cast<float>(z);
      point.sigma = 0.01F;
      point.area_m2 = static_cast<float>(step * step);
      if (!from.all_around) {
        point.away_x = static_cast<float>(away_x / length);
        point.away_y = static_cast<float>(away_y / length);
      }
      point.sensors = 1;
      cloud.contributions.resize(cloud.contributions.size() + 1);
      cloud.contributions[cloud.contributions.size() - 1] = {
          static_cast<std::uint32_t>(cloud.points.size()), 4, 300, 200, 3.0F, 0, 0};
      if (!cloud.points.try_push_back(point)) return;
    }
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
