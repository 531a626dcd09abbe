#include "pipeline/seen_share.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

struct Span {
  double min = 0, max = 0;
  double length() const { return std::max(0.0, max - min); }
};

// Where the tangents of a projected quadric cross one image axis (Hartley and Zisserman, dual
// conics): the roots of w u^2 - 2 c u + s = 0.
Span tangents(double s, double c, double w) {
  const double root = std::sqrt(std::max(0.0, c * c - s * w));
  return {(c + root) / w, (c - root) / w};  // w < 0
}

// The dual conic of the ellipsoid in the box, seen by the sensor, lens distortion left aside:
// C* = K (R diag(h^2) R^T - c c^T) K^T with the half axes h, rotation R and centre c in S.
Eigen::Matrix3d dual_conic(const Box& box, const RigSensor& sensor) {
  const Rigid X_SW = sensor.X_WS.inverse();
  const Eigen::Vector3d center_S = X_SW * Eigen::Map<const Eigen::Vector3d>(box.center.data());
  const Eigen::Vector3d half = 0.5 * Eigen::Map<const Eigen::Vector3d>(box.size.data());
  const Eigen::Matrix3d R_SE =
      (X_SW.rotation * Eigen::AngleAxisd(box.yaw, Eigen::Vector3d::UnitZ())).toRotationMatrix();
  Eigen::Matrix3d K = Eigen::Matrix3d::Identity();
  K << sensor.camera.fx, 0, sensor.camera.cx, 0, sensor.camera.fy, sensor.camera.cy, 0, 0, 1;
  const Eigen::Matrix3d spread = R_SE * half.cwiseAbs2().asDiagonal() * R_SE.transpose();
  return K * (spread - center_S * center_S.transpose()) * K.transpose();
}

double overlap(const Span& whole, int first, int last) {
  return Span{std::max(whole.min, first - 0.5), std::min(whole.max, last + 0.5)}.length();
}

}  // namespace

float seen_share(const Box& box, const RigSensor& sensor, const std::array<int, 4>& image_box) {
  const Eigen::Vector3d center_S =
      sensor.X_WS.inverse() * Eigen::Map<const Eigen::Vector3d>(box.center.data());
  const Eigen::Matrix3d conic = dual_conic(box, sensor);
  // Not wholly in front of the sensor: no outline.
  if (center_S.z() <= 0 || !(conic(2, 2) < 0)) return 0;
  const Span u = tangents(conic(0, 0), conic(0, 2), conic(2, 2));
  const Span v = tangents(conic(1, 1), conic(1, 2), conic(2, 2));
  const double whole = u.length() * v.length();
  if (!(whole > 0)) return 0;
  const double seen =
      overlap(u, image_box[0], image_box[2]) * overlap(v, image_box[1], image_box[3]);
  return static_cast<float>(seen / whole);
}

}  // namespace wagonsight
