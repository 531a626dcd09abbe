#pragma once

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>
#include <vector>

#include "calibrate/ball_outline.h"
#include "frame/image.h"
#include "geometry/camera.h"
#include "rig/rig.h"

// A ball as a camera's image and a depth camera see it.
namespace wagonsight::test {

// The exact outline of a sphere: rays that touch it, as an ellipse fitted to five of their pixels.
inline BallOutline outline_of(const Camera& camera, const Eigen::Vector3d& centre, double radius) {
  const Eigen::Vector3d axis = centre.normalized(), across = axis.unitOrthogonal(),
                        other = axis.cross(across);
  const double sine = radius / centre.norm(), cosine = std::sqrt(1 - sine * sine);
  std::vector<Eigen::Vector2d> pixels;
  for (int i = 0; i < 360; ++i) {
    const double t = i * 3.14159265358979 / 180;
    pixels.push_back(
        project(camera, cosine * axis + sine * (std::cos(t) * across + std::sin(t) * other))
            .value());
  }
  // An ellipse's centre is the mean of its extremes along x and along y; its axes follow from the
  // second moments of the conic, here by fitting a x^2 + b x y + c y^2 = 1 about the centre.
  Eigen::Vector2d low = pixels[0], high = pixels[0];
  for (const auto& p : pixels) low = low.cwiseMin(p), high = high.cwiseMax(p);
  BallOutline outline;
  outline.centre = (low + high) / 2;
  Eigen::MatrixXd A(static_cast<Eigen::Index>(pixels.size()), 3);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const Eigen::Vector2d d = pixels[i] - outline.centre;
    A.row(static_cast<Eigen::Index>(i)) << d.x() * d.x(), 2 * d.x() * d.y(), d.y() * d.y();
  }
  const Eigen::Vector3d conic = A.colPivHouseholderQr().solve(Eigen::VectorXd::Ones(A.rows()));
  Eigen::Matrix2d M;
  M << conic[0], conic[1], conic[1], conic[2];
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen(M);
  outline.semi_axes_px = eigen.eigenvalues().cwiseSqrt().cwiseInverse();
  outline.angle = std::atan2(eigen.eigenvectors()(1, 0), eigen.eigenvectors()(0, 0));
  return outline;
}

// Depth in millimetres of a ball on a post before a wall 3 m away; `noise` on each reading, a
// twentieth of them missing.
inline std::vector<std::uint16_t> depth_of_ball(const Camera& camera, const Eigen::Vector3d& centre,
                                                double radius, const DepthNoise& noise,
                                                std::mt19937& random) {
  constexpr double kWall = 3.0, kPost = 0.015;
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<std::uint16_t> raw(static_cast<std::size_t>(camera.width * camera.height));
  for (int v = 0; v < camera.height; ++v)
    for (int u = 0; u < camera.width; ++u) {
      const Eigen::Vector3d ray = ray_through(camera, Eigen::Vector2d(u, v)).value();
      // |z ray - centre| = radius, nearer solution.
      const double a = ray.squaredNorm(), b = ray.dot(centre),
                   c = centre.squaredNorm() - radius * radius;
      double z = b * b - a * c > 0 ? (b - std::sqrt(b * b - a * c)) / a : kWall;
      const Eigen::Vector3d at_post = centre.z() * ray;
      if (z == kWall && std::abs(at_post.x() - centre.x()) < kPost && at_post.y() > centre.y())
        z = centre.z();
      if (uniform(random) < 0.05) continue;
      z += noise.sigma(z) * normal(random);
      raw[static_cast<std::size_t>(v * camera.width + u)] =
          static_cast<std::uint16_t>(std::lround(1e3 * z));
    }
  return raw;
}

}  // namespace wagonsight::test
