// Covariances of all that the adjustment estimated. Board poses are eliminated one by one (Schur
// complement), so that the only matrix to be inverted has 15 rows an imager, however many views.
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "calibrate/problem.h"
#include "calibrate/reprojection.h"

namespace wagonsight::calibration {
namespace {

constexpr int kRows = 15;  // an imager: pose block, intrinsics block

// The normal equations' matrix in blocks.
struct Normal {
  Eigen::MatrixXd cameras;     // 15 n x 15 n
  std::vector<Matrix6> poses;  // by pose
  struct Coupling {
    int imager;
    Eigen::Matrix<double, kRows, 6> block;
  };
  std::vector<std::vector<Coupling>> couplings;  // by pose, an entry a view
};

void add_views(const Problem& problem, const std::vector<double>& sigma_px, Normal& normal) {
  std::vector<std::vector<const Observation*>> by_view(problem.views.size());
  for (const Observation& o : problem.observations)
    if (o.used) by_view[static_cast<std::size_t>(o.view)].push_back(&o);
  for (std::size_t v = 0; v < by_view.size(); ++v) {
    if (by_view[v].empty()) continue;
    const auto imager = static_cast<std::size_t>(problem.view_imager[v]);
    const auto pose = static_cast<std::size_t>(problem.view_pose[v]);
    const PoseBlock X_SB = to_block(problem.X_SB[imager]), X_BP = to_block(problem.X_BP[pose]);
    const IntrinsicsBlock k = to_block(problem.cameras[imager]);
    const ViewProjection projection(X_SB.data(), X_BP.data(), k.data());
    Eigen::Matrix<double, kRows, kRows> own = Eigen::Matrix<double, kRows, kRows>::Zero();
    Eigen::Matrix<double, kRows, 6> coupling = Eigen::Matrix<double, kRows, 6>::Zero();
    for (const Observation* o : by_view[v]) {
      Eigen::Vector2d pixel;
      PixelJacobians J;
      if (!projection.project(problem.board.point(o->id), pixel, &J)) continue;
      Eigen::Matrix<double, 2, kRows> camera;
      camera << J.X_SB, J.intrinsics;
      own += camera.transpose() * camera;
      coupling += camera.transpose() * J.X_BP;
      normal.poses[pose] += J.X_BP.transpose() * J.X_BP / (sigma_px[imager] * sigma_px[imager]);
    }
    const double weight = 1 / (sigma_px[imager] * sigma_px[imager]);
    const auto at = static_cast<Eigen::Index>(imager) * kRows;
    normal.cameras.block<kRows, kRows>(at, at) += weight * own;
    normal.couplings[pose].push_back({static_cast<int>(imager), weight * coupling});
  }
}

// d(distance of the two centres) / d(both pose blocks).
Eigen::Matrix<double, 1, 12> baseline_gradient(const Rigid& left, const Rigid& right) {
  const Eigen::Vector3d between = (left.inverse().position - right.inverse().position).normalized();
  Eigen::Matrix<double, 1, 12> gradient;
  for (int side = 0; side < 2; ++side) {
    const Rigid& X = side == 0 ? left : right;
    // c = -R^T t: dc/dt = -R^T, dc/dr = -R^T skew(t) J_l(r).
    const Eigen::Matrix3d R_t = X.rotation.toRotationMatrix().transpose();
    const Eigen::RowVector3d along = (side == 0 ? 1 : -1) * between.transpose() * -R_t;
    gradient.segment<3>(6 * side) = along * skew(X.position) * left_jacobian(rotation_vector(X));
    gradient.segment<3>(6 * side + 3) = along;
  }
  return gradient;
}

void add_what_is_known(const Problem& problem, Normal& normal) {
  for (std::size_t i = 0; i < problem.imagers.size(); ++i)
    for (std::size_t k = 0; k < kDistortionSigma.size(); ++k) {
      const auto at = static_cast<Eigen::Index>(i * kRows + 10 + k);
      normal.cameras(at, at) += 1 / (kDistortionSigma[k] * kDistortionSigma[k]);
    }
  for (const KnownBaseline& known : known_baselines(problem)) {
    const auto g = baseline_gradient(problem.X_SB[known.left], problem.X_SB[known.right]);
    const Eigen::Index at[2] = {static_cast<Eigen::Index>(known.left) * kRows,
                                static_cast<Eigen::Index>(known.right) * kRows};
    for (int a = 0; a < 2; ++a)
      for (int b = 0; b < 2; ++b)
        normal.cameras.block<6, 6>(at[a], at[b]) +=
            g.segment<6>(6 * a).transpose() * g.segment<6>(6 * b) / (known.sigma_m * known.sigma_m);
  }
}

Normal normal_equations(const Problem& problem, const std::vector<double>& sigma_px) {
  Normal normal;
  const auto rows = static_cast<Eigen::Index>(problem.imagers.size()) * kRows;
  normal.cameras = Eigen::MatrixXd::Zero(rows, rows);
  normal.poses.assign(problem.pose_names.size(), Matrix6::Zero());
  normal.couplings.resize(problem.pose_names.size());
  add_views(problem, sigma_px, normal);
  add_what_is_known(problem, normal);
  return normal;
}

// Inverse of a board pose's block; directions that no corner determines stay out (zero).
Matrix6 pose_inverse(const Matrix6& N) {
  const Eigen::SelfAdjointEigenSolver<Matrix6> eigen(N);
  constexpr double kUndetermined = 1e-12;
  Eigen::Matrix<double, 6, 1> inverse = Eigen::Matrix<double, 6, 1>::Zero();
  for (int i = 0; i < 6; ++i)
    if (eigen.eigenvalues()[i] > kUndetermined * eigen.eigenvalues()[5])
      inverse[i] = 1 / eigen.eigenvalues()[i];
  return eigen.eigenvectors() * inverse.asDiagonal() * eigen.eigenvectors().transpose();
}

// N_cameras minus what the board poses take away. The reference pose is known: it takes nothing.
Eigen::MatrixXd eliminate_poses(const Problem& problem, const Normal& normal,
                                std::vector<Matrix6>& inverses) {
  Eigen::MatrixXd S = normal.cameras;
  inverses.assign(normal.poses.size(), Matrix6::Zero());
  for (std::size_t p = 0; p < normal.poses.size(); ++p) {
    if (static_cast<int>(p) == problem.reference_pose || normal.couplings[p].empty()) continue;
    inverses[p] = pose_inverse(normal.poses[p]);
    for (const auto& a : normal.couplings[p]) {
      const Eigen::Matrix<double, kRows, 6> left = a.block * inverses[p];
      for (const auto& b : normal.couplings[p])
        S.block<kRows, kRows>(a.imager * kRows, b.imager * kRows) -= left * b.block.transpose();
    }
  }
  return S;
}

// Which of the 15 n parameters were estimated, and which were held at a value that is trusted to a
// stated sigma only.
struct Partition {
  std::vector<int> estimated, held;
  std::vector<double> held_variance;
};

Partition partition(const Problem& problem) {
  Partition parts;
  for (std::size_t i = 0; i < problem.imagers.size(); ++i) {
    const SensorSpec& spec = problem.spec(static_cast<int>(i));
    const Camera& camera = problem.cameras[i];
    for (int k = 0; k < kRows; ++k) {
      const int index = static_cast<int>(i) * kRows + k;
      if (k < 6 || !spec.fix_intrinsics) {
        parts.estimated.push_back(index);
        continue;
      }
      const double sigma = k == 6   ? spec.fixed_sigma_focal * camera.fx
                           : k == 7 ? spec.fixed_sigma_focal * camera.fy
                           : k < 10 ? spec.fixed_sigma_centre_px
                                    : 0.0;
      if (sigma > 0) parts.held.push_back(index), parts.held_variance.push_back(sigma * sigma);
    }
  }
  return parts;
}

// Sum of squares in units of the noise and the number of coordinates.
std::pair<double, Eigen::Index> weighted_squares(const Problem& problem,
                                                 const std::vector<double>& sigma_px) {
  double sum = 0;
  Eigen::Index coordinates = 0;
  for (const Observation& o : problem.observations) {
    if (!o.used) continue;
    const double sigma = sigma_px[static_cast<std::size_t>(o.imager)];
    sum += residual_of(problem, o).squaredNorm() / (sigma * sigma);
    coordinates += 2;
  }
  return {sum, coordinates};
}

// d(rotation in B, position in B of X_BS) / d(block of X_SB): p_BS = -R^T t, and the rotation
// vector r of X_SB turns X_BS by -R^T J_l(r) dr.
Matrix6 sensor_jacobian(const Rigid& X_SB) {
  const Eigen::Matrix3d R_t = X_SB.rotation.toRotationMatrix().transpose();
  const Eigen::Matrix3d left = left_jacobian(rotation_vector(X_SB));
  Matrix6 J = Matrix6::Zero();
  J.topLeftCorner<3, 3>() = -R_t * left;
  J.bottomLeftCorner<3, 3>() = -R_t * skew(X_SB.position) * left;
  J.bottomRightCorner<3, 3>() = -R_t;
  return J;
}

Matrix6 board_jacobian(const Rigid& X_BP) {
  Matrix6 J = Matrix6::Identity();
  J.topLeftCorner<3, 3>() = left_jacobian(rotation_vector(X_BP));
  return J;
}

// Of all 15 n camera parameters, block coordinates; zero where exactly fixed.
struct CameraCovariance {
  Eigen::MatrixXd C;
  double variance_factor = 1;
};

Result<CameraCovariance> camera_covariance(const Problem& problem, const Eigen::MatrixXd& S,
                                           const std::vector<double>& sigma_px) {
  const Partition parts = partition(problem);
  const Eigen::MatrixXd N = S(parts.estimated, parts.estimated);
  // Scaled to a unit diagonal, so that metres, pixels and distortion coefficients weigh alike.
  const Eigen::VectorXd scale = N.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::LDLT<Eigen::MatrixXd> factor(scale.asDiagonal() * N * scale.asDiagonal());
  constexpr double kSingular = 1e-14;
  if (factor.info() != Eigen::Success || !factor.isPositive() || factor.rcond() < kSingular)
    return fail(
        "the views do not determine every camera: the normal matrix is singular; add views "
        "with the board tilted and shared between cameras");
  const auto solve_scaled = [&](const Eigen::MatrixXd& right) -> Eigen::MatrixXd {
    return scale.asDiagonal() * factor.solve(scale.asDiagonal() * right);
  };
  CameraCovariance result;
  const auto [squares, coordinates] = weighted_squares(problem, sigma_px);
  std::vector<bool> pose_used(problem.pose_names.size(), false);
  for (const Observation& o : problem.observations)
    if (o.used) pose_used[static_cast<std::size_t>(o.pose)] = true;
  const auto poses = std::count(pose_used.begin(), pose_used.end(), true) - 1;
  const auto freedom = std::max<Eigen::Index>(1, coordinates - N.rows() - 6 * poses);
  // What remains of the scale of the noise, after weighing each imager by its own.
  result.variance_factor = squares / static_cast<double>(freedom);
  Eigen::MatrixXd C =
      result.variance_factor * solve_scaled(Eigen::MatrixXd::Identity(N.rows(), N.cols()));
  result.C = Eigen::MatrixXd::Zero(S.rows(), S.cols());
  if (!parts.held.empty()) {
    // Held parameters are wrong by their stated sigma and pull the estimate by N^-1 N_held.
    const Eigen::MatrixXd pull = solve_scaled(S(parts.estimated, parts.held));
    const Eigen::VectorXd variance = Eigen::Map<const Eigen::VectorXd>(
        parts.held_variance.data(), static_cast<Eigen::Index>(parts.held.size()));
    const Eigen::MatrixXd joint = -pull * variance.asDiagonal();
    C -= joint * pull.transpose();
    result.C(parts.estimated, parts.held) = joint;
    result.C(parts.held, parts.estimated) = joint.transpose();
    for (std::size_t h = 0; h < parts.held.size(); ++h)
      result.C(parts.held[h], parts.held[h]) = variance[static_cast<Eigen::Index>(h)];
  }
  result.C(parts.estimated, parts.estimated) = (C + C.transpose()) / 2;
  return result;
}

// Of each X_BP: its own noise, and what it takes over from the cameras.
std::vector<Matrix6> pose_covariances(const Problem& problem, const Normal& normal,
                                      const std::vector<Matrix6>& inverses,
                                      const CameraCovariance& cameras) {
  std::vector<Matrix6> result;
  for (std::size_t p = 0; p < normal.poses.size(); ++p) {
    Matrix6 C = cameras.variance_factor * inverses[p];
    for (const auto& a : normal.couplings[p])
      for (const auto& b : normal.couplings[p])
        C += inverses[p] * a.block.transpose() *
             cameras.C.block<kRows, kRows>(a.imager * kRows, b.imager * kRows) * b.block *
             inverses[p];
    const Matrix6 J = board_jacobian(problem.X_BP[p]);
    const Matrix6 turned = J * C * J.transpose();
    result.push_back((turned + turned.transpose()) / 2);
  }
  return result;
}

}  // namespace

Result<Adjustment> covariances(const Problem& problem, const std::vector<double>& sigma_px) {
  const Normal normal = normal_equations(problem, sigma_px);
  std::vector<Matrix6> inverses;
  const Eigen::MatrixXd S = eliminate_poses(problem, normal, inverses);
  const auto cameras = camera_covariance(problem, S, sigma_px);
  if (!cameras) return fail(cameras.error().message);
  Adjustment result;
  const auto n = static_cast<Eigen::Index>(problem.imagers.size());
  result.joint.resize(6 * n, 6 * n);
  for (Eigen::Index a = 0; a < n; ++a)
    for (Eigen::Index b = 0; b < n; ++b)
      result.joint.block<6, 6>(6 * a, 6 * b) =
          sensor_jacobian(problem.X_SB[static_cast<std::size_t>(a)]) *
          cameras->C.block<6, 6>(kRows * a, kRows * b) *
          sensor_jacobian(problem.X_SB[static_cast<std::size_t>(b)]).transpose();
  result.joint = (result.joint + result.joint.transpose()).eval() / 2;
  double pooled = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    result.sigma_intrinsics.emplace_back(
        cameras->C.diagonal().segment<4>(kRows * i + 6).cwiseMax(0).cwiseSqrt());
    result.imager_sigma_px.push_back(sigma_px[static_cast<std::size_t>(i)] *
                                     std::sqrt(cameras->variance_factor));
    pooled += result.imager_sigma_px.back() * result.imager_sigma_px.back();
  }
  result.sigma0_px = std::sqrt(pooled / static_cast<double>(n));
  result.poses = pose_covariances(problem, normal, inverses, *cameras);
  return result;
}

}  // namespace wagonsight::calibration
