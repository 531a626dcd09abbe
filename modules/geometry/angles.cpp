#include "geometry/angles.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace wagonsight {

OmegaPhiKappa to_omega_phi_kappa(const Eigen::Quaterniond& rotation) {
  const Eigen::Matrix3d R = rotation.normalized().toRotationMatrix();
  // R(2,0) = -sin phi, R(2,1) = cos phi sin omega, R(1,0) = sin kappa cos phi.
  OmegaPhiKappa angles;
  angles.phi = std::asin(std::clamp(-R(2, 0), -1.0, 1.0));
  constexpr double kGimbalCosine = 1e-9;
  if (std::hypot(R(0, 0), R(1, 0)) < kGimbalCosine) {
    angles.omega = std::atan2(-R(1, 2), R(1, 1));
    return angles;
  }
  angles.omega = std::atan2(R(2, 1), R(2, 2));
  angles.kappa = std::atan2(R(1, 0), R(0, 0));
  return angles;
}

Eigen::Quaterniond from_omega_phi_kappa(const OmegaPhiKappa& angles) {
  return Eigen::AngleAxisd(angles.kappa, Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(angles.phi, Eigen::Vector3d::UnitY()) *
         Eigen::AngleAxisd(angles.omega, Eigen::Vector3d::UnitX());
}

double wrap_angle(double radians) {
  const double folded = std::remainder(radians, 2 * std::numbers::pi);
  return folded <= -std::numbers::pi ? std::numbers::pi : folded;
}

Eigen::Quaterniond look_at(const Eigen::Vector3d& position, const Eigen::Vector3d& target) {
  const Eigen::Vector3d forward = (target - position).normalized();
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  if (std::abs(forward.z()) > 1 - 1e-9) up = Eigen::Vector3d::UnitY();
  const Eigen::Vector3d right = forward.cross(up).normalized();
  Eigen::Matrix3d R_WS;
  R_WS.col(0) = right;
  R_WS.col(1) = forward.cross(right);
  R_WS.col(2) = forward;
  return Eigen::Quaterniond(R_WS).normalized();
}

}  // namespace wagonsight
