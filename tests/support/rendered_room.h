#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "frame/image.h"
#include "geometry/angles.h"
#include "rig/ray_table.h"
#include "rig/rig.h"
#include "wagon/wagon.h"

// A small room of boxes seen by one depth camera with a Kinect's noise, for tests and benchmarks of
// what comes before people are looked for. Nothing here knows what a person looks like.
namespace wagonsight::testing_support {

struct RoomBox {
  Eigen::Vector3d min, max;
  bool invisible = false;  // gives no reading: glass
};

// A number of [0, 1) for a pixel of a frame; the same for the same arguments everywhere.
inline double hash_noise(std::uint64_t frame, std::uint64_t pixel) {
  std::uint64_t x = frame * 0x9E3779B97F4A7C15ULL + pixel * 0xD1B54A32D192ED03ULL + 1;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
  return static_cast<double>((x ^ (x >> 31)) >> 11) * 0x1p-53;
}

struct RenderedRoom {
  RigSensor sensor;
  Wagon wagon;
  std::vector<PixelRay> rays;
  std::vector<RoomBox> furniture;

  // `scale` 1 is a Kinect's 640 x 480.
  explicit RenderedRoom(double scale = 0.25) {
    sensor.name = "k0";
    sensor.camera.width = static_cast<int>(640 * scale);
    sensor.camera.height = static_cast<int>(480 * scale);
    sensor.camera.fx = sensor.camera.fy = 580 * scale;
    sensor.camera.cx = 320 * scale - 0.5;
    sensor.camera.cy = 240 * scale - 0.5;
    sensor.X_WS.position = {0.1, 1.35, 2.3};
    sensor.X_WS.rotation = look_at(sensor.X_WS.position, {3.2, 1.35, 0.6});
    wagon.inside = {{0, 0, 0}, {6.0, 2.7, 2.4}};
    rays = make_ray_table(sensor.camera);
    // Benches along one side and a table.
    furniture = {{{2.0, 0.0, 0.0}, {2.6, 1.0, 0.45}},
                 {{2.0, 0.0, 0.45}, {2.1, 1.0, 1.1}},
                 {{3.6, 0.0, 0.0}, {4.2, 1.0, 0.45}},
                 {{4.4, 1.9, 0.0}, {5.0, 2.7, 0.75}}};
  }

  static RoomBox somebody_at(double x, double y) {
    return {{x - 0.15, y - 0.25, 0.0}, {x + 0.15, y + 0.25, 1.7}};
  }

  // Raw millimetres with noise of frame number `frame`; negative: without noise. `is_box`
  // (optional) tells which pixels see one of `boxes`.
  std::vector<std::uint16_t> render(const std::vector<RoomBox>& boxes, int frame,
                                    std::vector<bool>* is_box = nullptr) const {
    std::vector<std::uint16_t> image(rays.size());
    if (is_box != nullptr) is_box->assign(rays.size(), false);
    const Eigen::Matrix3d R_WS = sensor.X_WS.rotation.toRotationMatrix();
    const Eigen::Vector3d& origin = sensor.X_WS.position;
    for (std::size_t pixel = 0; pixel < rays.size(); ++pixel) {
      const auto scale = static_cast<double>(kRayScale);
      const Eigen::Vector3d ray =
          R_WS * Eigen::Vector3d(rays[pixel].x * scale, rays[pixel].y * scale, 1.0);
      double z = through_the_walls(origin, ray);
      bool visible = true;
      const auto see = [&](const RoomBox& box, bool mark) {
        const double at = entry(box, origin, ray);
        if (at <= 0 || at >= z) return;
        z = at;
        visible = !box.invisible;
        if (is_box != nullptr) (*is_box)[pixel] = mark && visible;
      };
      for (const RoomBox& box : furniture) see(box, false);
      for (const RoomBox& box : boxes) see(box, true);
      if (visible) image[pixel] = reading(z, frame, pixel);
    }
    return image;
  }
  DepthImage view(const std::vector<std::uint16_t>& image) const {
    return {image.data(), sensor.camera.width, sensor.camera.height};
  }

 private:
  double through_the_walls(const Eigen::Vector3d& origin, const Eigen::Vector3d& ray) const {
    double z = 50;
    for (int axis = 0; axis < 3; ++axis) {
      const double wall = ray[axis] > 0 ? wagon.inside.max[axis] : wagon.inside.min[axis];
      z = std::min(z, (wall - origin[axis]) / ray[axis]);
    }
    return z;
  }
  static double entry(const RoomBox& box, const Eigen::Vector3d& origin,
                      const Eigen::Vector3d& ray) {
    const Eigen::Array3d a = (box.min - origin).array() / ray.array();
    const Eigen::Array3d b = (box.max - origin).array() / ray.array();
    const double enter = a.min(b).maxCoeff(), leave = a.max(b).minCoeff();
    return enter < leave ? enter : -1;
  }
  std::uint16_t reading(double z, int frame, std::size_t pixel) const {
    if (frame >= 0) {
      const auto f = static_cast<std::uint64_t>(frame);
      const double sum = hash_noise(f, pixel * 4) + hash_noise(f, pixel * 4 + 1) +
                         hash_noise(f, pixel * 4 + 2) + hash_noise(f, pixel * 4 + 3) - 2.0;
      // The sum's deviation is 0.577; a Kinect's steps are of equal disparity.
      const double steps = 1.0 / (sensor.noise.quantisation_per_z2 * z);
      const double noisy = z + sum / 0.577 * 0.6 * sensor.noise.sigma(z);
      z = std::round(steps * z / noisy) > 0 ? steps * z / std::round(steps * z / noisy) : 0;
    }
    return z > 0 && z < 9 ? static_cast<std::uint16_t>(std::lround(z * 1000)) : std::uint16_t{0};
  }
};

}  // namespace wagonsight::testing_support
