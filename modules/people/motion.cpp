#include "people/motion.h"

#include <Eigen/LU>
#include <cmath>

namespace wagonsight {
namespace {

constexpr double kWalkingSpeed = 1.5;  // m/s, one sigma of a velocity that nobody measured
// 99.9% of the measurements of a person who moves as modelled are nearer (chi square, 2).
constexpr double kSurprise2 = 13.8;

}  // namespace

MotionFilter::MotionFilter(const Eigen::Vector2d& position, double sigma) {
  state_ = {position.x(), position.y(), 0, 0};
  p_[0] = p_[5] = sigma * sigma;
  p_[10] = p_[15] = kWalkingSpeed * kWalkingSpeed;
}

void MotionFilter::predict(double dt, double acceleration) {
  Eigen::Matrix4d F = Eigen::Matrix4d::Identity();
  F(0, 2) = F(1, 3) = dt;
  const double q = acceleration * acceleration;
  Eigen::Matrix4d Q = Eigen::Matrix4d::Zero();
  for (int axis = 0; axis < 2; ++axis) {
    Q(axis, axis) = q * dt * dt * dt / 3;
    Q(axis, axis + 2) = Q(axis + 2, axis) = q * dt * dt / 2;
    Q(axis + 2, axis + 2) = q * dt;
  }
  Eigen::Map<Eigen::Vector4d> x(state_.data());
  Eigen::Map<Eigen::Matrix4d> P(p_.data());
  x = (F * x).eval();
  P = (F * P * F.transpose() + Q).eval();
}

double MotionFilter::distance2(const Eigen::Vector2d& position, double sigma) const {
  const Eigen::Matrix2d S =
      covariance().topLeftCorner<2, 2>() + sigma * sigma * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d innovation = position - this->position();
  return innovation.dot(S.inverse() * innovation);
}

void MotionFilter::correct(const Eigen::Vector2d& position, double sigma) {
  Eigen::Map<Eigen::Vector4d> x(state_.data());
  Eigen::Map<Eigen::Matrix4d> P(p_.data());
  const double surprise2 = distance2(position, sigma);
  if (surprise2 > kSurprise2) P *= surprise2 / kSurprise2;
  const Eigen::Matrix2d R = sigma * sigma * Eigen::Matrix2d::Identity();
  const Eigen::Matrix2d S = P.topLeftCorner<2, 2>() + R;
  const Eigen::Matrix<double, 4, 2> K = P.leftCols<2>() * S.inverse();
  x += (K * (position - x.head<2>())).eval();
  // Joseph's form stays symmetric and positive.
  Eigen::Matrix4d I_KH = Eigen::Matrix4d::Identity();
  I_KH.leftCols<2>() -= K;
  P = (I_KH * P * I_KH.transpose() + K * R * K.transpose()).eval();
}

void MotionFilter::slow_down(double dt, double time_constant) {
  const double kept = std::exp(-dt / time_constant);
  state_[2] *= kept;
  state_[3] *= kept;
}

Eigen::Vector2d MotionFilter::position_sigma() const {
  return {std::sqrt(p_[0]), std::sqrt(p_[5])};
}

}  // namespace wagonsight
