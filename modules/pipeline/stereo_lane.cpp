#include "pipeline/stereo_lane.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

bool same(const Camera& a, const Camera& b) {
  constexpr double kNothing_px = 1e-3;
  const auto near = [](double x, double y) { return std::abs(x - y) < kNothing_px; };
  return a.width == b.width && a.height == b.height && near(a.fx, b.fx) && near(a.fy, b.fy) &&
         near(a.cx, b.cx) && near(a.cy, b.cy) && !a.has_distortion() && !b.has_distortion();
}

bool meets(const Eigen::Vector3d& origin, const Eigen::Vector3d& ray, const Bounds& box) {
  double enter = 0, leave = 1e9;
  for (int axis = 0; axis < 3; ++axis) {
    const double step = std::abs(ray[axis]) < 1e-12 ? 1e-12 : ray[axis];
    const double a = (box.min[axis] - origin[axis]) / step;
    const double b = (box.max[axis] - origin[axis]) / step;
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter <= leave;
}

}  // namespace

Result<StereoRectification> rectification_of(const RigSensor& sensor) {
  const StereoGeometry& stereo = sensor.stereo;
  if (!stereo.has_lenses()) {
    StereoRectification rectified;
    rectified.camera = sensor.camera;
    rectified.baseline = stereo.baseline;
    return rectified;
  }
  auto rectification = make_rectification(stereo.left, stereo.right, stereo.X_LR);
  if (!rectification)
    return fail(fmt::format("sensor {}: {}", sensor.name.view(), rectification.error().message));
  if (!same(rectification->camera, sensor.camera))
    return fail(
        fmt::format("sensor {}: its rectified camera is not the one that follows from its "
                    "lenses; pack the calibration again",
                    sensor.name.view()));
  return rectification;
}

std::vector<std::uint64_t> exposure_mask(const RigSensor& sensor, RayTable rays,
                                         const Wagon& wagon) {
  std::vector<std::uint64_t> mask((rays.size() + 63) / 64);
  const Eigen::Matrix3d R_WS = sensor.X_WS.rotation.toRotationMatrix();
  for (std::size_t pixel = 0; pixel < rays.size(); ++pixel) {
    const double scale = static_cast<double>(kRayScale);
    const Eigen::Vector3d ray =
        R_WS * Eigen::Vector3d(scale * rays[pixel].x, scale * rays[pixel].y, 1);
    const bool outside = std::any_of(
        wagon.masks.begin(), wagon.masks.end(),
        [&](const MaskVolume& volume) { return meets(sensor.X_WS.position, ray, volume.bounds); });
    if (!outside) mask[pixel / 64] |= std::uint64_t{1} << (pixel % 64);
  }
  return mask;
}

}  // namespace wagonsight
