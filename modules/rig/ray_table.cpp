#include "rig/ray_table.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace wagonsight {
namespace {

constexpr PixelRay kNoPixelRay{kNoRay, 0};

// Both coordinates must fit and neither may be kNoRay by chance.
PixelRay to_fixed_point(const Eigen::Vector3d& ray) {
  const double x = std::round(ray.x() / static_cast<double>(kRayScale));
  const double y = std::round(ray.y() / static_cast<double>(kRayScale));
  if (!(std::abs(x) <= INT16_MAX) || !(std::abs(y) <= INT16_MAX)) return kNoPixelRay;
  return {static_cast<std::int16_t>(x), static_cast<std::int16_t>(y)};
}

}  // namespace

std::vector<PixelRay> make_ray_table(const Camera& camera) {
  std::vector<PixelRay> rays;
  rays.reserve(static_cast<std::size_t>(std::max(camera.width, 0)) *
               static_cast<std::size_t>(std::max(camera.height, 0)));
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const auto ray = ray_through(camera, Eigen::Vector2d(u, v));
      rays.push_back(ray ? to_fixed_point(*ray) : kNoPixelRay);
    }
  }
  return rays;
}

}  // namespace wagonsight
