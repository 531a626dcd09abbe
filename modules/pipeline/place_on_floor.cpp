#include "pipeline/place_on_floor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "wagon/floor.h"

namespace wagonsight {
namespace {

constexpr double kCeiling = 2.4;            // metres: nobody's head is higher
constexpr std::size_t kPointsMax = 60'000;  // enough for a plane
constexpr double kHalfWidthMax = 6.0;       // metres to either side of the sensor

std::vector<Eigen::Vector3f> sample_points(std::span<const DepthImage> images, RayTable rays,
                                           const RigSensor& sensor) {
  std::vector<Eigen::Vector3f> points;
  const std::size_t pixels = images.size() * rays.size();
  const std::size_t stride = std::max<std::size_t>(1, pixels / kPointsMax) | 1U;
  for (std::size_t at = 0; at < pixels; at += stride) {
    const DepthImage& image = images[at / rays.size()];
    const std::size_t pixel = at % rays.size();
    const std::uint16_t raw = image.pixels[pixel];
    const PixelRay ray = rays[pixel];
    if (raw == 0 || ray.x == kNoRay) continue;
    const double z = sensor.depth_scale * 1e-3 * raw + sensor.depth_offset;
    if (z < sensor.trim_near || z > sensor.trim_far) continue;
    points.emplace_back(static_cast<float>(z) * kRayScale * static_cast<float>(ray.x),
                        static_cast<float>(z) * kRayScale * static_cast<float>(ray.y),
                        static_cast<float>(z));
  }
  return points;
}

Bounds seen_by(const RigSensor& sensor) {
  // The sideways reach of the image at the far trim, or what a room of this kind may have.
  const double half_angle_tan = 0.5 * static_cast<double>(sensor.camera.width) / sensor.camera.fx;
  const double half_width = std::clamp(1.1 * half_angle_tan * sensor.trim_far, 1.0, kHalfWidthMax);
  Bounds inside;
  inside.min = {0, -half_width, 0};
  inside.max = {sensor.trim_far, half_width, kCeiling};
  return inside;
}

Result<void> check_sizes(std::span<const DepthImage> images, RayTable rays,
                         const RigSensor& sensor) {
  for (const DepthImage& image : images)
    if (image.pixel_count() != rays.size())
      return fail(
          fmt::format("sensor {}: its images have {} pixels and its camera {}; state the "
                      "size of the images in the camera file",
                      sensor.name.view(), image.pixel_count(), rays.size()));
  return {};
}

struct Vertical {
  Eigen::Vector3d up_S = -Eigen::Vector3d::UnitY();  // of the image
  double floor_m = 1.2;                              // below the sensor
};

// A ceiling is the floor of a room that stands on its head.
Vertical vertical_of(const std::vector<Eigen::Vector3f>& points_S) {
  constexpr double kRoomHeight = 2.5;
  std::vector<Eigen::Vector3f> turned;
  turned.reserve(points_S.size());
  for (const Eigen::Vector3f& p : points_S) turned.emplace_back(-p.x(), -p.y(), p.z());
  Vertical vertical;
  if (const auto ceiling = find_floor(turned)) {
    const Eigen::Vector3d down = ceiling->X_WS.rotation.inverse() * Eigen::Vector3d::UnitZ();
    vertical.up_S = {down.x(), down.y(), -down.z()};
    vertical.floor_m = std::max(0.3, kRoomHeight - ceiling->X_WS.position.z());
  }
  return vertical;
}

}  // namespace

Result<void> place_level(std::span<const DepthImage> images, RayTable rays, RigSensor& sensor,
                         Wagon& wagon) {
  if (auto fits = check_sizes(images, rays, sensor); !fits) return fits;
  const auto points = sample_points(images, rays, sensor);
  if (points.size() < 100)
    return fail(
        fmt::format("sensor {}: there are next to no readings within its trim_m = [{}, {}]; check "
                    "depth_unit_m and trim_m in the camera file",
                    sensor.name.view(), sensor.trim_near, sensor.trim_far));
  const Vertical vertical = vertical_of(points);
  std::vector<double> heights;
  heights.reserve(points.size());
  for (const Eigen::Vector3f& p : points) heights.push_back(vertical.up_S.dot(p.cast<double>()));
  const auto lowest = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 200);
  std::nth_element(heights.begin(), lowest, heights.end());
  const double floor_m = std::clamp(std::max(vertical.floor_m, -*lowest), 0.3, 3.0);
  Eigen::Vector3d forward = Eigen::Vector3d::UnitZ();
  forward = (forward - vertical.up_S * vertical.up_S.z()).normalized();
  Eigen::Matrix3d R_WS;
  R_WS.row(0) = forward;
  R_WS.row(1) = vertical.up_S.cross(forward);
  R_WS.row(2) = vertical.up_S;
  sensor.X_WS = {Eigen::Quaterniond(R_WS).normalized(), {0, 0, floor_m}};
  sensor.has_pose = true;
  if (wagon.inside.max == wagon.inside.min) wagon.inside = seen_by(sensor);
  return {};
}

Result<void> place_on_floor(std::span<const DepthImage> images, RayTable rays, RigSensor& sensor,
                            Wagon& wagon) {
  if (auto fits = check_sizes(images, rays, sensor); !fits) return fits;
  const auto points = sample_points(images, rays, sensor);
  const auto floor = find_floor(points);
  if (!floor)
    return fail(
        fmt::format("sensor {}: no floor is seen in the recording; give its pose in the "
                    "camera file ([pose] position and rotation)",
                    sensor.name.view()));
  sensor.X_WS = floor->X_WS;
  sensor.has_pose = true;
  if (wagon.inside.max == wagon.inside.min) wagon.inside = seen_by(sensor);
  return {};
}

}  // namespace wagonsight
