#include "wagon/floor.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace wagonsight {
namespace {

constexpr std::size_t kPointsMax = 40'000;      // enough for millimetres
constexpr std::size_t kScorePointsMax = 6'000;  // enough to rank hypotheses
constexpr float kCell_m = 0.4F;                 // in which a first plane is fitted
constexpr std::size_t kCellPointsMin = 20;
constexpr std::size_t kRefined = 12;  // of the best hypotheses
constexpr double kSupportMin = 0.02;
// A floor has nothing below it but reflections; a desk has the floor.
constexpr double kBelowCost = 3.0;
constexpr double kHeightMin_m = 0.3;  // of the sensor
constexpr double kInsideMargin_m = 0.2;

struct Plane {  // normal . p + offset = 0; the normal points up, so offset is the sensor's height
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  double offset = 0;
  double score = -1;
  double support = 0;
};

// How far from the plane a reading of it may lie: two and a half sigmas of a Kinect (0.0019 z^2
// along the ray, and a stereo camera of the same price), seen at the angle at which the ray meets
// the plane.
double tolerance(const Plane& plane, const Eigen::Vector3d& p) {
  const double cosine = std::abs(plane.normal.dot(p)) / std::max(p.z(), 0.1);
  return 0.012 + 0.005 * p.z() * p.z() * cosine;
}

void score(Plane& plane, std::span<const Eigen::Vector3f> points) {
  std::size_t on = 0, below = 0;
  for (const Eigen::Vector3f& p : points) {
    const double height = plane.normal.dot(p.cast<double>()) + plane.offset;
    const double allowed = tolerance(plane, p.cast<double>());
    if (std::abs(height) <= allowed) {
      ++on;
    } else if (height < -3 * allowed) {
      ++below;
    }
  }
  const auto count = static_cast<double>(points.size());
  plane.support = static_cast<double>(on) / count;
  plane.score = plane.support - kBelowCost * static_cast<double>(below) / count;
}

class PlaneFit {
 public:
  void add(const Eigen::Vector3d& p, double weight) {
    weight_ += weight;
    sum_ += weight * p;
    squares_ += weight * p * p.transpose();
    ++count_;
  }
  std::size_t count() const { return count_; }
  // The plane through the mean with the least spread, its normal on the side of `up`.
  Plane plane(const Eigen::Vector3d& up, double* flatness = nullptr) const {
    const Eigen::Vector3d mean = sum_ / weight_;
    const Eigen::Matrix3d covariance = squares_ / weight_ - mean * mean.transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
    Plane result;
    result.normal = solver.eigenvectors().col(0);
    if (result.normal.dot(up) < 0) result.normal = -result.normal;
    result.offset = -result.normal.dot(mean);
    if (flatness != nullptr) *flatness = solver.eigenvalues()[0] / solver.eigenvalues()[1];
    return result;
  }

 private:
  double weight_ = 0;
  std::size_t count_ = 0;
  Eigen::Vector3d sum_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares_ = Eigen::Matrix3d::Zero();
};

std::vector<Eigen::Vector3f> thin(std::span<const Eigen::Vector3f> points, std::size_t count_max) {
  std::vector<Eigen::Vector3f> result;
  const std::size_t step = points.size() / count_max + 1;
  for (std::size_t i = 0; i < points.size(); i += step) result.push_back(points[i]);
  return result;
}

bool allowed(const Plane& plane, const Eigen::Vector3d& up, double tilt_max) {
  return plane.offset > kHeightMin_m && plane.normal.dot(up) >= std::cos(std::min(tilt_max, 1.55));
}

// One plane for every cube of points that is flat and level enough.
std::vector<Plane> hypotheses(std::vector<Eigen::Vector3f> points, const Eigen::Vector3d& up,
                              double tilt_max) {
  const auto cell_of = [](const Eigen::Vector3f& p) {
    return std::array<int, 3>{static_cast<int>(std::floor(p.x() / kCell_m)),
                              static_cast<int>(std::floor(p.y() / kCell_m)),
                              static_cast<int>(std::floor(p.z() / kCell_m))};
  };
  std::stable_sort(points.begin(), points.end(),
                   [&](const auto& a, const auto& b) { return cell_of(a) < cell_of(b); });
  std::vector<Plane> planes;
  for (std::size_t first = 0; first < points.size();) {
    PlaneFit fit;
    const auto cell = cell_of(points[first]);
    std::size_t end = first;
    for (; end < points.size() && cell_of(points[end]) == cell; ++end) {
      fit.add(points[end].cast<double>(), 1.0);
    }
    first = end;
    if (fit.count() < kCellPointsMin) continue;
    double flatness = 1;
    const Plane plane = fit.plane(up, &flatness);
    if (flatness < 0.2 && allowed(plane, up, tilt_max)) planes.push_back(plane);
  }
  return planes;
}

// Least squares over the points near the plane, weighted by a depth sensor's precision.
double refine(Plane& plane, std::span<const Eigen::Vector3f> points, const Eigen::Vector3d& up) {
  double squares = 0, count = 0;
  for (int round = 0; round < 6; ++round) {
    // Wide first, so that a plane from one small patch can turn towards the others.
    const double widen = round < 2 ? 2.0 : 1.0;
    PlaneFit fit;
    squares = count = 0;
    for (const Eigen::Vector3f& point : points) {
      const Eigen::Vector3d p = point.cast<double>();
      const double height = plane.normal.dot(p) + plane.offset;
      const double near = tolerance(plane, p);
      if (std::abs(height) > widen * near) continue;
      fit.add(p, 1.0 / (near * near));
      squares += height * height;
      ++count;
    }
    if (fit.count() < kCellPointsMin) break;
    plane = fit.plane(up);
  }
  return std::sqrt(squares / std::max(count, 1.0));
}

// W stands on the floor below the sensor, which looks along +x (or, looking straight down, has its
// image's top towards +x).
Rigid stand_on(const Plane& floor, const Eigen::Vector3d& up) {
  Eigen::Vector3d forward = Eigen::Vector3d::UnitZ();
  forward -= floor.normal * floor.normal.dot(forward);
  if (forward.norm() < 0.05) forward = up - floor.normal * floor.normal.dot(up);
  forward.normalize();
  Eigen::Matrix3d R_WS;
  R_WS.row(0) = forward;
  R_WS.row(1) = floor.normal.cross(forward);
  R_WS.row(2) = floor.normal;
  return {Eigen::Quaterniond(R_WS).normalized(), {0, 0, floor.offset}};
}

}  // namespace

std::optional<FloorEstimate> find_floor(std::span<const Eigen::Vector3f> points_S,
                                        double tilt_max) {
  const Eigen::Vector3d up = -Eigen::Vector3d::UnitY();  // of the image
  const std::vector<Eigen::Vector3f> points = thin(points_S, kPointsMax);
  if (points.size() < kCellPointsMin) return std::nullopt;
  const std::vector<Eigen::Vector3f> few = thin(points, kScorePointsMax);
  std::vector<Plane> planes = hypotheses(points, up, tilt_max);
  for (Plane& plane : planes) score(plane, few);
  std::stable_sort(planes.begin(), planes.end(),
                   [](const Plane& a, const Plane& b) { return a.score > b.score; });
  planes.resize(std::min(planes.size(), kRefined));
  Plane best;
  double best_rms = 0;
  for (Plane& plane : planes) {
    const double rms = refine(plane, points, up);
    score(plane, points);
    if (plane.score > best.score && allowed(plane, up, tilt_max)) {
      best = plane;
      best_rms = rms;
    }
  }
  if (best.score < 0 || best.support < kSupportMin) return std::nullopt;
  return FloorEstimate{stand_on(best, up), best_rms, best.support};
}

Bounds find_inside(std::span<const Eigen::Vector3f> points_W, double height_max) {
  Bounds inside;
  inside.max.z() = height_max;
  for (int axis = 0; axis < 2; ++axis) {
    std::vector<float> along;
    for (const Eigen::Vector3f& p : points_W) {
      if (p.z() > -0.2F && p.z() < static_cast<float>(height_max)) along.push_back(p[axis]);
    }
    if (along.empty()) along.push_back(0.0F);
    const auto at = [&](std::size_t index) {
      std::nth_element(along.begin(), along.begin() + static_cast<std::ptrdiff_t>(index),
                       along.end());
      return static_cast<double>(along[index]);
    };
    // The sensor itself is inside: somebody may stand before it where no floor is seen.
    inside.min[axis] = std::min(0.0, at(along.size() / 100)) - kInsideMargin_m;
    inside.max[axis] = std::max(0.0, at(along.size() - 1 - along.size() / 100)) + kInsideMargin_m;
  }
  return inside;
}

}  // namespace wagonsight
