#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "drift/depth_grid.h"
#include "geometry/angles.h"
#include "rig/ray_table.h"
#include "rig/rig.h"

// A room of boxes as a noisy depth camera sees it, on the drift monitor's grid.
namespace wagonsight::drift_test {

using Box = Eigen::AlignedBox3d;

inline RigSensor make_sensor() {
  RigSensor sensor;
  sensor.name = "k0";
  sensor.camera.width = 640, sensor.camera.height = 480;
  sensor.camera.fx = sensor.camera.fy = 580, sensor.camera.cx = 319.5, sensor.camera.cy = 239.5;
  sensor.X_WS = {look_at({0.3, 1.3, 2.2}, {3.0, 1.5, 0.6}), {0.3, 1.3, 2.2}};
  return sensor;
}

// 6 x 2.7 x 2.4 m with four seats and a partition.
inline std::vector<Box> wagon_boxes() {
  std::vector<Box> boxes;
  for (const double x : {1.5, 3.2, 4.6})
    for (const double y : {0.0, 1.9})
      boxes.emplace_back(Eigen::Vector3d(x, y, 0), Eigen::Vector3d(x + 0.45, y + 0.8, 0.45)),
          boxes.emplace_back(Eigen::Vector3d(x + 0.45, y, 0),
                             Eigen::Vector3d(x + 0.55, y + 0.8, 1.2));
  boxes.emplace_back(Eigen::Vector3d(5.2, 0, 0), Eigen::Vector3d(5.3, 1.0, 2.4));
  return boxes;
}

inline Box wagon_inside() {
  return {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(6, 2.7, 2.4)};
}

class Room {
 public:
  Room(const RigSensor& sensor, std::vector<Box> boxes, Box inside = wagon_inside())
      : grid{sensor.camera.width, sensor.camera.height},
        rays(make_ray_table(sensor.camera)),
        noise_(sensor.noise),
        boxes_(std::move(boxes)),
        inside_(inside) {}

  // The grid's readings from a sensor at X_WS, quantised as a Kinect's; depths times `scale`.
  std::vector<std::uint16_t> look(const Rigid& X_WS, unsigned seed, double scale = 1,
                                  const std::vector<Box>& people = {}) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    std::vector<std::uint16_t> readings(grid.size());
    for (std::size_t cell = 0; cell < grid.size(); ++cell) {
      const PixelRay ray = rays[grid.pixel(cell)];
      const Eigen::Vector3d along(kRayScale * static_cast<float>(ray.x),
                                  kRayScale * static_cast<float>(ray.y), 1);
      double z = hit(X_WS.position, X_WS.rotation * along, people) * scale;
      z += noise_.sigma(z) * normal(random);
      const double step = noise_.step(z);
      if (step > 0) z = std::round(z / step) * step;
      readings[cell] = z > 0 && z < 8 ? static_cast<std::uint16_t>(std::lround(z * 1000)) : 0;
    }
    return readings;
  }

  DepthGrid grid;
  std::vector<PixelRay> rays;

 private:
  double hit(const Eigen::Vector3d& o, const Eigen::Vector3d& d,
             const std::vector<Box>& people) const {
    double nearest = std::numeric_limits<double>::infinity();
    for (int k = 0; k < 3; ++k)  // out of the room
      if (d[k] != 0)
        nearest = std::min(nearest, ((d[k] > 0 ? inside_.max() : inside_.min())[k] - o[k]) / d[k]);
    for (const auto* list : {&boxes_, &people})
      for (const Box& box : *list) {
        double enter = 0, leave = nearest;
        for (int k = 0; k < 3; ++k) {
          const double a = (box.min()[k] - o[k]) / d[k], b = (box.max()[k] - o[k]) / d[k];
          enter = std::max(enter, std::min(a, b));
          leave = std::min(leave, std::max(a, b));
        }
        if (enter < leave && enter > 0) nearest = enter;
      }
    return nearest;
  }

  DepthNoise noise_;
  std::vector<Box> boxes_;
  Box inside_;
};

}  // namespace wagonsight::drift_test
