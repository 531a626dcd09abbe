#pragma once

#include <Eigen/Core>
#include <array>

#include "calibrate/problem.h"

// The observation equation of the bundle adjustment (the paper's equation 1) with its derivatives,
// written once for the solver and for the covariances.
namespace wagonsight::calibration {

using PoseBlock = std::array<double, 6>;        // rotation vector, position
using IntrinsicsBlock = std::array<double, 9>;  // fx, fy, cx, cy, k1, k2, p1, p2, k3

PoseBlock to_block(const Rigid& X);
Rigid to_rigid(const PoseBlock& block);
IntrinsicsBlock to_block(const Camera& camera);
void write_intrinsics(const IntrinsicsBlock& block, Camera& camera);

// Derivatives of a corner's pixel.
struct PixelJacobians {
  Eigen::Matrix<double, 2, 6> X_SB, X_BP;
  Eigen::Matrix<double, 2, 9> intrinsics;
};

// What all corners of one view share: board pose, imager pose and lens. `X_SB`, `X_BP` are 6
// numbers each, `intrinsics` 9, which must outlive it. Does not allocate.
class ViewProjection {
 public:
  ViewProjection(const double* X_SB, const double* X_BP, const double* intrinsics);

  // False when the point lies behind the imager. `jacobians` may be null.
  bool project(const Eigen::Vector3d& p_P, Eigen::Vector2d& pixel, PixelJacobians* jacobians) const;

 private:
  Eigen::Matrix3d R_SB_, R_BP_, right_SB_, right_BP_;
  Eigen::Vector3d t_SB_, t_BP_;
  const double* k_;
};

// Left Jacobian of the rotation group: exp(r + d) = exp(J_l(r) d) exp(r) to first order
// (Sola, Deray, Atchuthan 2018, equation 145).
Eigen::Matrix3d left_jacobian(const Eigen::Vector3d& rotation_vector);

Eigen::Matrix3d skew(const Eigen::Vector3d& a);  // skew(a) b = a x b

}  // namespace wagonsight::calibration
