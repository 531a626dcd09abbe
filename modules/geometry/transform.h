#pragma once

#include <Eigen/Geometry>

namespace wagonsight {

// A rigid motion. X_AB maps a point's coordinates from frame B to frame A: p_A = X_AB * p_B.
// Frames: S sensor (its depth camera, x right, y down, z forward), B board, W world (z up).
// Metres. The rotation is a unit quaternion; nothing allocates.
struct Rigid {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d position = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& p) const { return rotation * p + position; }
  // Composition: X_AC = X_AB * X_BC.
  Rigid operator*(const Rigid& other) const {
    return {(rotation * other.rotation).normalized(), rotation * other.position + position};
  }
  Rigid inverse() const {
    const Eigen::Quaterniond back = rotation.conjugate();
    return {back, -(back * position)};
  }
};

// p_A = scale * rotation * p_B + position (the paper's equation 7, lambda = scale > 0).
struct Similarity {
  double scale = 1.0;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d position = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& p) const {
    return scale * (rotation * p) + position;
  }
  Similarity operator*(const Similarity& other) const {
    return {scale * other.scale, (rotation * other.rotation).normalized(),
            scale * (rotation * other.position) + position};
  }
  Similarity inverse() const {
    const Eigen::Quaterniond back = rotation.conjugate();
    return {1.0 / scale, back, -(back * position) / scale};
  }
};

}  // namespace wagonsight
