#include "people/describe.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

// A head is 0.22 to 0.25 m high; its centre lies half of that below the top.
constexpr float kHeadHeight = 0.22F;
constexpr float kHeadRadius = 0.09F;
// Shoulders are about 0.18 of the height below its top: 0.31 m for 1.75 m.
constexpr float kShoulderShare = 0.18F;
constexpr float kShoulderBand = 0.08F;
constexpr double kHeadAreaMin = 0.01;
constexpr double kShoulderSpanMin = 0.25;
constexpr double kShoulderSpanMax = 0.65;

}  // namespace

std::span<const BodyShape> Describer::describe(const FusedCloud& cloud,
                                               std::span<const std::uint16_t> labels,
                                               std::span<const Detection> detections) {
  sums_.clear();
  sums_.resize(detections.size());
  for (Sums& s : sums_) s = Sums{};
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (labels[i] == kNoDetection) continue;
    const FusedPoint& p = cloud.points[i];
    const Detection& detection = detections[labels[i]];
    Sums& s = sums_[labels[i]];
    const double w = p.area_m2;
    const double x = p.x;
    const double y = p.y;
    const double z = p.z;
    s.area += w;
    s.first[0] += w * x;
    s.first[1] += w * y;
    s.first[2] += w * z;
    s.second[0] += w * x * x;
    s.second[1] += w * x * y;
    s.second[2] += w * x * z;
    s.second[3] += w * y * y;
    s.second[4] += w * y * z;
    s.second[5] += w * z * z;
    const float below = detection.top - p.z;
    if (below < kHeadHeight) {
      s.head_area += w;
      s.head_x += w * (x + kHeadRadius * p.away_x);
      s.head_y += w * (y + kHeadRadius * p.away_y);
    } else if (std::abs(below - kShoulderShare * detection.top) < kShoulderBand) {
      s.shoulder_area += w;
      s.shoulder_x += w * x;
      s.shoulder_y += w * y;
      s.shoulder_xx += w * x * x;
      s.shoulder_xy += w * x * y;
      s.shoulder_yy += w * y * y;
    }
  }
  for (Sums& s : sums_) {  // the longer horizontal axis
    const double w = std::max(s.area, 1e-9);
    const double xx = s.second[0] / w - s.first[0] * s.first[0] / (w * w);
    const double xy = s.second[1] / w - s.first[0] * s.first[1] / (w * w);
    const double yy = s.second[3] / w - s.first[1] * s.first[1] / (w * w);
    const double yaw = 0.5 * std::atan2(2 * xy, xx - yy);
    s.yaw_cos = std::cos(yaw);
    s.yaw_sin = std::sin(yaw);
  }
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (labels[i] == kNoDetection) continue;
    const FusedPoint& p = cloud.points[i];
    Sums& s = sums_[labels[i]];
    const double a = s.yaw_cos * p.x + s.yaw_sin * p.y;
    const double b = -s.yaw_sin * p.x + s.yaw_cos * p.y;
    s.low_a = std::min(s.low_a, a);
    s.high_a = std::max(s.high_a, a);
    s.low_b = std::min(s.low_b, b);
    s.high_b = std::max(s.high_b, b);
  }
  shapes_.clear();
  shapes_.resize(detections.size());
  for (std::size_t i = 0; i < detections.size(); ++i) {
    shapes_[i] = BodyShape{};
    if (sums_[i].area > 0) finish(detections[i], sums_[i], shapes_[i]);
  }
  return shapes_.span();
}

void Describer::finish(const Detection& detection, const Sums& s, BodyShape& shape) const {
  const double a = 0.5 * (s.low_a + s.high_a);
  const double b = 0.5 * (s.low_b + s.high_b);
  shape.box.center = {s.yaw_cos * a - s.yaw_sin * b, s.yaw_sin * a + s.yaw_cos * b,
                      0.5 * (detection.top + detection.bottom)};
  shape.box.size = {s.high_a - s.low_a, s.high_b - s.low_b, detection.top - detection.bottom};
  shape.box.yaw = std::atan2(s.yaw_sin, s.yaw_cos);

  const Eigen::Vector3d mean = Eigen::Vector3d(s.first[0], s.first[1], s.first[2]) / s.area;
  Eigen::Matrix3d covariance;
  covariance << s.second[0], s.second[1], s.second[2],  //
      s.second[1], s.second[3], s.second[4],            //
      s.second[2], s.second[4], s.second[5];
  covariance = (covariance / s.area - mean * mean.transpose()).eval();
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(covariance);
  Eigen::Matrix3d axes = solver.eigenvectors().rowwise().reverse();  // longest first
  if (axes.determinant() < 0) axes.col(2) *= -1;
  const Eigen::Quaterniond rotation(axes);
  shape.ellipsoid.center = {mean.x(), mean.y(), mean.z()};
  for (int axis = 0; axis < 3; ++axis)
    // A shell's points lie at its semi axis: variance a^2 / 3.
    shape.ellipsoid.semi_axes[static_cast<std::size_t>(axis)] =
        std::sqrt(3 * std::max(0.0, solver.eigenvalues()[2 - axis]));
  shape.ellipsoid.rotation = {rotation.w(), rotation.x(), rotation.y(), rotation.z()};

  const bool upright = detection.top - detection.bottom > 0.3F;
  if (upright && !detection.cut_top && s.head_area >= kHeadAreaMin) {
    shape.has_head = true;
    shape.head = {s.head_x / s.head_area, s.head_y / s.head_area,
                  detection.top - 0.5 * kHeadHeight};
  }
  if (shape.has_head && s.shoulder_area > kHeadAreaMin) {
    const double x = s.shoulder_x / s.shoulder_area;
    const double y = s.shoulder_y / s.shoulder_area;
    const double xx = s.shoulder_xx / s.shoulder_area - x * x;
    const double xy = s.shoulder_xy / s.shoulder_area - x * y;
    const double yy = s.shoulder_yy / s.shoulder_area - y * y;
    const double major = 0.5 * (xx + yy) + std::hypot(0.5 * (xx - yy), xy);
    const double span = std::sqrt(12 * std::max(0.0, major));
    const double yaw = 0.5 * std::atan2(2 * xy, xx - yy);
    const double z = detection.top - kShoulderShare * detection.top;
    if (span >= kShoulderSpanMin && span <= kShoulderSpanMax) {
      shape.has_shoulders = true;
      const double half_x = 0.5 * span * std::cos(yaw);
      const double half_y = 0.5 * span * std::sin(yaw);
      shape.shoulder_a = {x + half_x, y + half_y, z};
      shape.shoulder_b = {x - half_x, y - half_y, z};
    }
  }
}

}  // namespace wagonsight
