#include "calibrate/reprojection.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace wagonsight::calibration {

namespace {

Eigen::Vector3d head(const double* block) {
  return {block[0], block[1], block[2]};
}
Eigen::Vector3d tail(const double* block) {
  return {block[3], block[4], block[5]};
}

Eigen::Matrix3d rotation_of(const Eigen::Vector3d& r) {
  const double angle = r.norm();
  if (angle < 1e-12) return Eigen::Matrix3d::Identity() + skew(r);
  return Eigen::AngleAxisd(angle, r / angle).toRotationMatrix();
}

}  // namespace

Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d S;
  S << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return S;
}

Eigen::Matrix3d left_jacobian(const Eigen::Vector3d& r) {
  const double angle2 = r.squaredNorm(), angle = std::sqrt(angle2);
  // Series below: the closed form loses its digits there.
  const bool small = angle < 1e-4;
  const double a = small ? 0.5 - angle2 / 24 : (1 - std::cos(angle)) / angle2;
  const double b = small ? 1.0 / 6 - angle2 / 120 : (angle - std::sin(angle)) / (angle2 * angle);
  const Eigen::Matrix3d S = skew(r);
  return Eigen::Matrix3d::Identity() + a * S + b * S * S;
}

PoseBlock to_block(const Rigid& X) {
  const Eigen::Vector3d r = rotation_vector(X);
  return {r.x(), r.y(), r.z(), X.position.x(), X.position.y(), X.position.z()};
}

Rigid to_rigid(const PoseBlock& b) {
  return to_rigid({b[0], b[1], b[2]}, {b[3], b[4], b[5]});
}

IntrinsicsBlock to_block(const Camera& c) {
  return {c.fx,
          c.fy,
          c.cx,
          c.cy,
          c.distortion[0],
          c.distortion[1],
          c.distortion[2],
          c.distortion[3],
          c.distortion[4]};
}

void write_intrinsics(const IntrinsicsBlock& block, Camera& camera) {
  camera.fx = block[0], camera.fy = block[1], camera.cx = block[2], camera.cy = block[3];
  std::copy(block.begin() + 4, block.end(), camera.distortion.begin());
}

ViewProjection::ViewProjection(const double* X_SB, const double* X_BP, const double* intrinsics)
    : R_SB_(rotation_of(head(X_SB))),
      R_BP_(rotation_of(head(X_BP))),
      // J_r(r) = J_l(-r); a point turned by exp(r) moves by -R skew(p) J_r(r) dr.
      right_SB_(left_jacobian(-head(X_SB))),
      right_BP_(left_jacobian(-head(X_BP))),
      t_SB_(tail(X_SB)),
      t_BP_(tail(X_BP)),
      k_(intrinsics) {}

bool ViewProjection::project(const Eigen::Vector3d& p_P, Eigen::Vector2d& pixel,
                             PixelJacobians* jacobians) const {
  const Eigen::Vector3d p_B = R_BP_ * p_P + t_BP_;
  const Eigen::Vector3d p_S = R_SB_ * p_B + t_SB_;
  constexpr double kNearest = 1e-6;
  if (!(p_S.z() > kNearest)) return false;
  const double x = p_S.x() / p_S.z(), y = p_S.y() / p_S.z();
  const double r2 = x * x + y * y;
  const double k1 = k_[4], k2 = k_[5], p1 = k_[6], p2 = k_[7], k3 = k_[8];
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x);
  const double yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y;
  const double fx = k_[0], fy = k_[1];
  pixel = {fx * xd + k_[2], fy * yd + k_[3]};
  if (jacobians == nullptr) return true;

  const double d_radial = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));  // d radial / d r2, doubled
  const double cross = x * y * d_radial + 2 * p1 * x + 2 * p2 * y;
  Eigen::Matrix2d normalised;  // d pixel / d (x, y)
  normalised << fx * (radial + x * x * d_radial + 2 * p1 * y + 6 * p2 * x), fx * cross, fy * cross,
      fy * (radial + y * y * d_radial + 6 * p1 * y + 2 * p2 * x);
  Eigen::Matrix<double, 2, 3> in_sensor;
  const double inverse_z = 1 / p_S.z();
  in_sensor.col(0) = normalised.col(0) * inverse_z;
  in_sensor.col(1) = normalised.col(1) * inverse_z;
  in_sensor.col(2) = -(normalised * Eigen::Vector2d(x, y)) * inverse_z;
  const Eigen::Matrix<double, 2, 3> in_board = in_sensor * R_SB_;
  jacobians->X_SB.leftCols<3>() = -in_board * skew(p_B) * right_SB_;
  jacobians->X_SB.rightCols<3>() = in_sensor;
  jacobians->X_BP.leftCols<3>() = -(in_board * R_BP_) * skew(p_P) * right_BP_;
  jacobians->X_BP.rightCols<3>() = in_board;
  jacobians->intrinsics << xd, 0, 1, 0, fx * x * r2, fx * x * r2 * r2, fx * 2 * x * y,
      fx * (r2 + 2 * x * x), fx * x * r2 * r2 * r2,  //
      0, yd, 0, 1, fy * y * r2, fy * y * r2 * r2, fy * (r2 + 2 * y * y), fy * 2 * x * y,
      fy * y * r2 * r2 * r2;
  return true;
}

}  // namespace wagonsight::calibration
