#include "geometry/camera.h"

#include <Eigen/LU>
#include <cmath>

namespace wagonsight {

Eigen::Vector2d distort(const Camera& camera, const Eigen::Vector2d& normalised) {
  const auto& [k1, k2, p1, p2, k3] = camera.distortion;
  const double x = normalised.x(), y = normalised.y();
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  return {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
          y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
}

std::optional<Eigen::Vector2d> undistort(const Camera& camera, const Eigen::Vector2d& distorted) {
  if (!camera.has_distortion()) return distorted;
  const auto& [k1, k2, p1, p2, k3] = camera.distortion;
  Eigen::Vector2d p = distorted;
  for (int iteration = 0; iteration < 30; ++iteration) {
    const Eigen::Vector2d residual = distort(camera, p) - distorted;
    if (residual.norm() < 1e-10) return p;
    const double x = p.x(), y = p.y(), r2 = x * x + y * y;
    const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
    const double slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));  // d radial / d r2, times two
    Eigen::Matrix2d J;
    J(0, 0) = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x;
    J(0, 1) = x * y * slope + 2 * p1 * x + 2 * p2 * y;
    J(1, 0) = J(0, 1);
    J(1, 1) = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x;
    // A determinant that is not positive means that the distortion folds the image over here.
    if (J.determinant() <= 1e-9) return std::nullopt;
    p -= J.inverse() * residual;
  }
  return std::nullopt;
}

std::optional<Eigen::Vector2d> project(const Camera& camera, const Eigen::Vector3d& p_S) {
  if (!(p_S.z() > 0)) return std::nullopt;
  const Eigen::Vector2d d = distort(camera, p_S.head<2>() / p_S.z());
  return Eigen::Vector2d(camera.fx * d.x() + camera.cx, camera.fy * d.y() + camera.cy);
}

std::optional<Eigen::Vector3d> ray_through(const Camera& camera, const Eigen::Vector2d& pixel) {
  const Eigen::Vector2d distorted((pixel.x() - camera.cx) / camera.fx,
                                  (pixel.y() - camera.cy) / camera.fy);
  const auto ideal = undistort(camera, distorted);
  if (!ideal) return std::nullopt;
  return Eigen::Vector3d(ideal->x(), ideal->y(), 1.0);
}

}  // namespace wagonsight
