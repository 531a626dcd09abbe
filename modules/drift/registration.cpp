#include "drift/registration.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

using Vector7 = Eigen::Matrix<double, 7, 1>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;

constexpr float kReach = 0.15F;        // metres to a point of then
constexpr double kArm = 2.0;           // metres: turns and scale are judged by what they move there
constexpr double kVagueSigma = 0.003;  // metres: known less well than this, and said so
// Beyond, what is left of a direction is the errors that a wall's normals share: it is not touched.
constexpr double kBlindSigma = 0.008;
// What is thought of a sensor before it is looked at: it stands within this of its place (metres,
// at the arm's end). It matters only where the view tells little.
constexpr double kPriorSigma = 0.02;
constexpr double kTukey = 4.685;
constexpr double kSigmaMin = 0.002;  // metres: below are errors that all points of a wall share
// Points of one wall err together (its normal, the sensor's pattern), so that many count as one.
constexpr double kPointsAsOne = 25;
constexpr double kWeightMax = 2;  // near points have the errors of normals, too
constexpr std::size_t kPointsMin = 250;
constexpr int kIterations = 12;

// Of equal weight by what the sensor's noise is at that depth; as long as they are at the arm's
// end.
struct Equation {
  Vector7 row;  // turn (times the arm), shift, scale (times the arm)
  double residual = 0;
};

struct Pose {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
  double scale = 1;
  Eigen::Vector3d operator*(const Eigen::Vector3d& p) const {
    return scale * (rotation * p) + shift;
  }
};

std::vector<Equation> equations(const StaticSurface& surface,
                                std::span<const Eigen::Vector3f> now_S, const DepthNoise& noise,
                                const Pose& pose) {
  std::vector<Equation> list;
  list.reserve(now_S.size());
  for (const Eigen::Vector3f& seen : now_S) {
    const Eigen::Vector3d p = pose * seen.cast<double>();
    const StaticSurface::Point* then = surface.nearest(p.cast<float>(), kReach);
    if (then == nullptr) continue;
    const double weight = std::min(kWeightMax, noise.sigma(kArm) / noise.sigma(seen.z()));
    const Eigen::Vector3d n = weight * then->normal_S.cast<double>();
    Equation equation;
    equation.row.head<3>() = p.cross(n) / kArm;
    equation.row.segment<3>(3) = n;
    equation.row[6] = n.dot(p) / kArm;
    equation.residual = n.dot(then->p_S.cast<double>() - p);
    list.push_back(equation);
  }
  return list;
}

double robust_sigma(const std::vector<Equation>& list) {
  std::vector<double> lengths;
  lengths.reserve(list.size());
  for (const Equation& equation : list) lengths.push_back(std::abs(equation.residual));
  const auto middle = lengths.begin() + static_cast<std::ptrdiff_t>(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  return std::max(kSigmaMin, 1.4826 * *middle);
}

struct Solved {
  Vector7 step = Vector7::Zero();
  Matrix7 covariance = Matrix7::Zero();
  std::vector<Vector7> vague;  // unit vectors
  int fitting = 0;
};

// One Gauss-Newton step from `now`, the motion so far in the rows' units.
Solved solve(const std::vector<Equation>& list, double sigma, const Vector7& now) {
  Matrix7 N = Matrix7::Zero();
  Vector7 g = Vector7::Zero();
  Solved solved;
  for (const Equation& equation : list) {
    const double u = equation.residual / (kTukey * sigma);
    if (std::abs(u) >= 1) continue;
    const double weight = (1 - u * u) * (1 - u * u);
    N += weight * equation.row * equation.row.transpose();
    g += weight * equation.residual * equation.row;
    ++solved.fitting;
  }
  const Eigen::SelfAdjointEigenSolver<Matrix7> eigen(N);
  const double variance_of_one = sigma * sigma * kPointsAsOne;
  const double prior = variance_of_one / (kPriorSigma * kPriorSigma);
  for (int k = 0; k < 7; ++k) {
    const Vector7 direction = eigen.eigenvectors().col(k);
    const double told = std::max(eigen.eigenvalues()[k], 1e-9);
    if (variance_of_one / told > kVagueSigma * kVagueSigma) solved.vague.push_back(direction);
    if (variance_of_one / told > kBlindSigma * kBlindSigma) continue;
    const double value = told + prior;
    solved.step += direction * ((direction.dot(g) - prior * direction.dot(now)) / value);
    solved.covariance += variance_of_one / value * direction * direction.transpose();
  }
  return solved;
}

std::string name_of(const Vector7& direction) {
  static const char* const kNames[] = {
      "pitch",      "yaw", "roll", "shift to the side", "shift up or down", "shift along its axis",
      "depth scale"};
  // What the direction consists of, the largest part first.
  std::array<int, 7> order = {0, 1, 2, 3, 4, 5, 6};
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return std::abs(direction[a]) > std::abs(direction[b]); });
  std::string name = kNames[order[0]];
  if (std::abs(direction[order[1]]) > 0.6 * std::abs(direction[order[0]]))
    name += std::string(" with ") + kNames[order[1]];
  return name;
}

}  // namespace

SensorMotion register_onto(const StaticSurface& surface, std::span<const Eigen::Vector3f> now_S,
                           const DepthNoise& noise) {
  SensorMotion motion;
  Pose pose;
  Solved solved;
  std::size_t met = 0;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const std::vector<Equation> list = equations(surface, now_S, noise, pose);
    met = list.size();
    if (met < kPointsMin) return motion;
    const Eigen::AngleAxisd so_far(pose.rotation);
    Vector7 parameters;
    parameters << kArm * so_far.angle() * so_far.axis(), pose.shift, kArm * (pose.scale - 1);
    solved = solve(list, robust_sigma(list), parameters);
    const Eigen::Vector3d turn = solved.step.head<3>() / kArm;
    if (turn.norm() > 0) {
      const Eigen::Quaterniond by(Eigen::AngleAxisd(turn.norm(), turn.normalized()));
      pose.rotation = (by * pose.rotation).normalized();
      pose.shift = by * pose.shift;
    }
    const double scale = 1 + solved.step[6] / kArm;
    pose.scale *= scale;
    pose.shift = scale * pose.shift + solved.step.segment<3>(3);
    if (solved.step.norm() < 2e-5) break;
  }
  const Eigen::AngleAxisd turned(pose.rotation);
  motion.known = solved.fitting >= static_cast<int>(kPointsMin);
  motion.shift_m = pose.shift;
  motion.turn_rad = turned.angle() * turned.axis();
  motion.scale = pose.scale;
  const auto along = [](const Eigen::Matrix3d& covariance, const Eigen::Vector3d& way) {
    return way.norm() > 0 ? std::sqrt(way.dot(covariance * way)) / way.norm()
                          : std::sqrt(covariance.trace() / 3);
  };
  motion.sigma_turn_rad = along(solved.covariance.topLeftCorner<3, 3>(), motion.turn_rad) / kArm;
  motion.sigma_shift_m = along(solved.covariance.block<3, 3>(3, 3), motion.shift_m);
  motion.sigma_scale = std::sqrt(solved.covariance(6, 6)) / kArm;
  motion.points = solved.fitting;
  motion.fitting_share = static_cast<double>(solved.fitting) / static_cast<double>(now_S.size());
  for (const Vector7& direction : solved.vague) motion.vague.push_back(name_of(direction));
  return motion;
}

}  // namespace wagonsight
