#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

namespace wagonsight {

// A pinhole camera with Brown's radial and tangential distortion (Brown 1971; OpenCV's first five
// coefficients k1, k2, p1, p2, k3). Pixels are 0-based, a pixel's centre has integer coordinates.
struct Camera {
  int width = 0;
  int height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  std::array<double, 5> distortion{};

  bool has_distortion() const { return distortion != std::array<double, 5>{}; }
};

// Normalised image coordinates (x/z, y/z) after distortion:
//   x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), likewise y_d.
Eigen::Vector2d distort(const Camera& camera, const Eigen::Vector2d& normalised);

// The inverse, by Newton's method on the 2x2 Jacobian. Nothing where it does not converge to
// 1e-10, which happens only outside of the field in which the distortion is invertible.
std::optional<Eigen::Vector2d> undistort(const Camera& camera, const Eigen::Vector2d& distorted);

// Pixel of a point in the camera's frame S (metres, z forward); nothing for z <= 0.
std::optional<Eigen::Vector2d> project(const Camera& camera, const Eigen::Vector3d& p_S);

// The ray (x, y, 1) through a pixel, so that depth * ray is the point; nothing as in undistort.
std::optional<Eigen::Vector3d> ray_through(const Camera& camera, const Eigen::Vector2d& pixel);

}  // namespace wagonsight
