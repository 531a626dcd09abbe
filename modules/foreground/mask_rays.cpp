#include "foreground/mask_rays.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

constexpr double kNear_m = 0.001;

bool meets(const Eigen::Vector3d& origin, const Eigen::Vector3d& ray, const Bounds& box) {
  double enter = 0, leave = 1e9;
  for (int axis = 0; axis < 3; ++axis) {
    const double step = std::abs(ray[axis]) < 1e-12 ? 1e-12 : ray[axis];
    const double a = (box.min[axis] - kNear_m - origin[axis]) / step;
    const double b = (box.max[axis] + kNear_m - origin[axis]) / step;
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter <= leave;
}

}  // namespace

std::vector<std::uint64_t> rays_into_masks(const RigSensor& sensor, RayTable rays,
                                           const Wagon& wagon) {
  std::vector<std::uint64_t> into((rays.size() + 63) / 64);
  const Eigen::Matrix3d R_WS = sensor.X_WS.rotation.toRotationMatrix();
  for (std::size_t pixel = 0; pixel < rays.size() && !wagon.masks.empty(); ++pixel) {
    const double scale = static_cast<double>(kRayScale);
    const Eigen::Vector3d ray =
        R_WS * Eigen::Vector3d(scale * rays[pixel].x, scale * rays[pixel].y, 1);
    const bool met = std::any_of(
        wagon.masks.begin(), wagon.masks.end(),
        [&](const MaskVolume& volume) { return meets(sensor.X_WS.position, ray, volume.bounds); });
    if (met) into[pixel / 64] |= std::uint64_t{1} << (pixel % 64);
  }
  return into;
}

}  // namespace wagonsight
