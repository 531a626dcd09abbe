#pragma once

#include <Eigen/Core>
#include <array>

namespace wagonsight {

// Position and velocity of a person on the floor: a Kalman filter with constant velocity, driven
// by white noise acceleration (Bar-Shalom et al. 2001, section 6.2.2). State (x, y, vx, vy), world
// frame, metres and seconds. Never allocates.
class MotionFilter {
 public:
  MotionFilter() = default;
  // Starts at a measured position with an unknown velocity of a walking person.
  MotionFilter(const Eigen::Vector2d& position, double sigma);

  // Moves `dt` >= 0 seconds on; `acceleration` is the spectral density's root, m/s^1.5.
  void predict(double dt, double acceleration);
  // Takes a measured position with standard deviation `sigma` on both axes. One that the filter
  // deems most unlikely widens the filter's own doubt first, so that a person who moves faster
  // than the stated frame rate suggests is followed at once.
  void correct(const Eigen::Vector2d& position, double sigma);
  // Squared Mahalanobis distance of a measurement.
  double distance2(const Eigen::Vector2d& position, double sigma) const;
  // While nobody is seen, a walk slows down: velocity decays with this time constant, seconds.
  void slow_down(double dt, double time_constant);

  Eigen::Vector2d position() const { return {state_[0], state_[1]}; }
  Eigen::Vector2d velocity() const { return {state_[2], state_[3]}; }
  Eigen::Vector2d position_sigma() const;
  Eigen::Matrix4d covariance() const { return Eigen::Map<const Eigen::Matrix4d>(p_.data()); }

 private:
  // Plain numbers, so that tracks are flat.
  std::array<double, 4> state_{};
  std::array<double, 16> p_{};  // covariance, symmetric
};

}  // namespace wagonsight
