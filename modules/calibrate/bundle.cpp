// Bundle adjustment with Ceres (the paper's equation 1). The only file that includes Ceres.
#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "calibrate/problem.h"

namespace wagonsight::calibration {
namespace {

using PoseBlock = std::array<double, 6>;        // rotation vector, position
using IntrinsicsBlock = std::array<double, 9>;  // fx, fy, cx, cy, k1, k2, p1, p2, k3

// Measured minus reprojected pixel of one corner, in units of its imager's noise.
struct Reprojection {
  Eigen::Vector3d on_board;
  Eigen::Vector2d pixel;
  double weight;

  template <class T>
  bool operator()(const T* X_SB, const T* X_BP, const T* k, T* residual) const {
    const T p_P[3] = {T(on_board.x()), T(on_board.y()), T(on_board.z())};
    T p_B[3], p_S[3];
    ceres::AngleAxisRotatePoint(X_BP, p_P, p_B);
    for (int i = 0; i < 3; ++i) p_B[i] += X_BP[3 + i];
    ceres::AngleAxisRotatePoint(X_SB, p_B, p_S);
    for (int i = 0; i < 3; ++i) p_S[i] += X_SB[3 + i];
    if (!(p_S[2] > T(1e-6))) return false;
    const T x = p_S[0] / p_S[2], y = p_S[1] / p_S[2];
    const T r2 = x * x + y * y;
    const T radial = T(1) + r2 * (k[4] + r2 * (k[5] + r2 * k[8]));
    const T xd = x * radial + T(2) * k[6] * x * y + k[7] * (r2 + T(2) * x * x);
    const T yd = y * radial + k[6] * (r2 + T(2) * y * y) + T(2) * k[7] * x * y;
    residual[0] = T(weight) * (T(pixel.x()) - k[0] * xd - k[2]);
    residual[1] = T(weight) * (T(pixel.y()) - k[1] * yd - k[3]);
    return true;
  }
};

// Distortion is weakly held to zero: no lens of these has coefficients beyond about one, and a
// camera that sees the board in one corner only must not invent them.
struct DistortionPrior {
  template <class T>
  bool operator()(const T* k, T* residual) const {
    const double inverse_sigma[5] = {1.0 / 2.0, 1.0 / 4.0, 1.0 / 0.1, 1.0 / 0.1, 1.0 / 4.0};
    for (int i = 0; i < 5; ++i) residual[i] = T(inverse_sigma[i]) * k[4 + i];
    return true;
  }
};

// |t_left - t_right| is known for a stereo camera whose baseline was stated.
struct BaselinePrior {
  double baseline, sigma;
  template <class T>
  bool operator()(const T* left, const T* right, T* residual) const {
    // Centres in B: -R^T t.
    T centre_left[3], centre_right[3], distance2 = T(0);
    for (const auto& [block, centre] : {std::pair{left, centre_left}, {right, centre_right}}) {
      const T back[3] = {-block[0], -block[1], -block[2]};
      ceres::AngleAxisRotatePoint(back, block + 3, centre);
    }
    for (int i = 0; i < 3; ++i) {
      const T d = centre_left[i] - centre_right[i];
      distance2 += d * d;
    }
    using std::sqrt;
    residual[0] = (sqrt(distance2) - T(baseline)) / T(sigma);
    return true;
  }
};

// The parameter blocks of a problem, for as long as one adjustment lasts.
struct Blocks {
  std::vector<PoseBlock> X_SB, X_BP;
  std::vector<IntrinsicsBlock> intrinsics;

  explicit Blocks(const Problem& problem) {
    const auto pack = [](const Rigid& X) {
      const Eigen::Vector3d r = rotation_vector(X);
      return PoseBlock{r.x(), r.y(), r.z(), X.position.x(), X.position.y(), X.position.z()};
    };
    for (const Rigid& X : problem.X_SB) X_SB.push_back(pack(X));
    for (const Rigid& X : problem.X_BP) X_BP.push_back(pack(X));
    for (const Camera& c : problem.cameras)
      intrinsics.push_back({c.fx, c.fy, c.cx, c.cy, c.distortion[0], c.distortion[1],
                            c.distortion[2], c.distortion[3], c.distortion[4]});
  }

  void write_to(Problem& problem) const {
    const auto unpack = [](const PoseBlock& b) {
      return to_rigid({b[0], b[1], b[2]}, {b[3], b[4], b[5]});
    };
    for (std::size_t i = 0; i < X_SB.size(); ++i) problem.X_SB[i] = unpack(X_SB[i]);
    for (std::size_t i = 0; i < X_BP.size(); ++i) problem.X_BP[i] = unpack(X_BP[i]);
    for (std::size_t i = 0; i < intrinsics.size(); ++i) {
      Camera& c = problem.cameras[i];
      const IntrinsicsBlock& k = intrinsics[i];
      c.fx = k[0], c.fy = k[1], c.cx = k[2], c.cy = k[3];
      std::copy(k.begin() + 4, k.end(), c.distortion.begin());
    }
  }
};

bool is_fixed(const Problem& problem, std::size_t imager) {
  return problem.spec(static_cast<int>(imager)).fix_intrinsics;
}

// Adds all residuals. `sigma_px` by imager weighs them; `loss` may be null.
void build(const Problem& problem, Blocks& blocks, const std::vector<double>& sigma_px,
           ceres::LossFunction* loss, ceres::Problem& adjustment) {
  std::vector<bool> pose_used(blocks.X_BP.size(), false);
  for (const Observation& o : problem.observations) {
    if (!o.used) continue;
    const auto imager = static_cast<std::size_t>(o.imager), pose = static_cast<std::size_t>(o.pose);
    pose_used[pose] = true;
    auto* cost = new ceres::AutoDiffCostFunction<Reprojection, 2, 6, 6, 9>(
        new Reprojection{problem.board.point(o.id), o.pixel, 1.0 / sigma_px[imager]});
    adjustment.AddResidualBlock(cost, loss, blocks.X_SB[imager].data(), blocks.X_BP[pose].data(),
                                blocks.intrinsics[imager].data());
  }
  const auto reference = static_cast<std::size_t>(problem.reference_pose);
  if (pose_used[reference]) adjustment.SetParameterBlockConstant(blocks.X_BP[reference].data());
  for (std::size_t i = 0; i < blocks.intrinsics.size(); ++i) {
    if (!adjustment.HasParameterBlock(blocks.intrinsics[i].data())) continue;
    if (is_fixed(problem, i)) {
      adjustment.SetParameterBlockConstant(blocks.intrinsics[i].data());
      continue;
    }
    adjustment.AddResidualBlock(
        new ceres::AutoDiffCostFunction<DistortionPrior, 5, 9>(new DistortionPrior), nullptr,
        blocks.intrinsics[i].data());
  }
  for (std::size_t i = 0; i + 1 < problem.imagers.size(); ++i) {
    const SensorSpec& spec = problem.spec(static_cast<int>(i));
    if (!spec.baseline_m || problem.imagers[i].sensor_index != problem.imagers[i + 1].sensor_index)
      continue;
    adjustment.AddResidualBlock(new ceres::AutoDiffCostFunction<BaselinePrior, 1, 6, 6>(
                                    new BaselinePrior{*spec.baseline_m, spec.baseline_sigma_m}),
                                nullptr, blocks.X_SB[i].data(), blocks.X_SB[i + 1].data());
  }
}

Result<void> run(Problem& problem, const std::vector<double>& sigma_px, double robust_px,
                 int iterations_max) {
  Blocks blocks(problem);
  ceres::Problem::Options ownership;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::CauchyLoss cauchy(robust_px > 0 ? robust_px : 1.0);
  ceres::Problem adjustment(ownership);
  build(problem, blocks, sigma_px, robust_px > 0 ? &cauchy : nullptr, adjustment);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = iterations_max;
  options.function_tolerance = 1e-12;
  options.gradient_tolerance = 1e-12;
  options.parameter_tolerance = 1e-12;
  options.num_threads = 1;  // sums in one order: the same input gives the same output
  options.logging_type = ceres::SILENT;
  auto* order = new ceres::ParameterBlockOrdering;
  for (auto& block : blocks.X_BP)
    if (adjustment.HasParameterBlock(block.data())) order->AddElementToGroup(block.data(), 0);
  for (auto& block : blocks.X_SB)
    if (adjustment.HasParameterBlock(block.data())) order->AddElementToGroup(block.data(), 1);
  for (auto& block : blocks.intrinsics)
    if (adjustment.HasParameterBlock(block.data())) order->AddElementToGroup(block.data(), 1);
  options.linear_solver_ordering.reset(order);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &adjustment, &summary);
  if (!summary.IsSolutionUsable())
    return fail(fmt::format("the bundle adjustment failed: {}", summary.message));
  blocks.write_to(problem);
  return {};
}

Eigen::Vector2d residual_of(const Problem& problem, const Observation& o) {
  const Rigid X_SP = problem.X_SB[static_cast<std::size_t>(o.imager)] *
                     problem.X_BP[static_cast<std::size_t>(o.pose)];
  return o.pixel - reproject(problem, o.imager, X_SP, o.id);
}

// The noise of one coordinate of each imager, from the median length of its residuals (Rayleigh).
std::vector<double> robust_sigmas(const Problem& problem) {
  std::vector<std::vector<double>> lengths(problem.imagers.size());
  for (const Observation& o : problem.observations)
    lengths[static_cast<std::size_t>(o.imager)].push_back(residual_of(problem, o).norm());
  std::vector<double> sigmas;
  for (auto& list : lengths) {
    constexpr double kRayleighMedian = 1.17741;
    constexpr double kSigmaMin = 0.02;  // pixels; perfect synthetic corners would divide by zero
    double sigma = 1.0;
    if (!list.empty()) {
      const auto middle = list.begin() + static_cast<std::ptrdiff_t>(list.size() / 2);
      std::nth_element(list.begin(), middle, list.end());
      sigma = std::max(kSigmaMin, *middle / kRayleighMedian);
    }
    sigmas.push_back(sigma);
  }
  return sigmas;
}

void reject_gross_errors(Problem& problem, const std::vector<double>& sigma_px, double sigmas) {
  for (Observation& o : problem.observations)
    o.used = residual_of(problem, o).norm() < sigmas * sigma_px[static_cast<std::size_t>(o.imager)];
}

// The normal matrix of all parameters, in blocks: imager poses, board poses without the reference,
// intrinsics. Prior information is included.
struct Normal {
  Eigen::MatrixXd N;
  std::vector<int> imager_at, intrinsics_at;
  Eigen::Index rows = 0;
};

Normal normal_matrix(Problem& problem, const std::vector<double>& sigma_px) {
  Blocks blocks(problem);
  ceres::Problem adjustment;
  build(problem, blocks, sigma_px, nullptr, adjustment);
  std::vector<double*> order;
  Normal result;
  int at = 0;
  const auto add = [&](double* block, int size) {
    order.push_back(block);
    at += size;
    return at - size;
  };
  for (auto& block : blocks.X_SB) result.imager_at.push_back(add(block.data(), 6));
  for (std::size_t p = 0; p < blocks.X_BP.size(); ++p)
    if (static_cast<int>(p) != problem.reference_pose &&
        adjustment.HasParameterBlock(blocks.X_BP[p].data()))
      add(blocks.X_BP[p].data(), 6);
  for (std::size_t i = 0; i < blocks.intrinsics.size(); ++i) {
    adjustment.SetParameterBlockVariable(blocks.intrinsics[i].data());
    result.intrinsics_at.push_back(add(blocks.intrinsics[i].data(), 9));
  }
  ceres::Problem::EvaluateOptions options;
  options.parameter_blocks = order;
  options.num_threads = 1;
  ceres::CRSMatrix J;
  adjustment.Evaluate(options, nullptr, nullptr, nullptr, &J);
  result.N = Eigen::MatrixXd::Zero(at, at);
  for (int row = 0; row < J.num_rows; ++row) {
    const auto begin = static_cast<std::size_t>(J.rows[static_cast<std::size_t>(row)]);
    const auto end = static_cast<std::size_t>(J.rows[static_cast<std::size_t>(row) + 1]);
    for (std::size_t a = begin; a < end; ++a)
      for (std::size_t b = begin; b < end; ++b)
        result.N(J.cols[a], J.cols[b]) += J.values[a] * J.values[b];
  }
  result.rows = J.num_rows;
  return result;
}

// d(rotation in B, position in B of X_BS) / d(block of X_SB), by central differences: the map is
// smooth and six by six, so an analytic form would only add places for a mistake.
Matrix6 pose_jacobian(const Rigid& X_SB) {
  const Eigen::Vector3d r = rotation_vector(X_SB);
  const Rigid X_BS = X_SB.inverse();
  Matrix6 J;
  for (int k = 0; k < 6; ++k) {
    constexpr double kStep = 1e-6;
    Eigen::Matrix<double, 6, 1> difference[2];
    for (int side = 0; side < 2; ++side) {
      Eigen::Vector3d rotation = r, position = X_SB.position;
      (k < 3 ? rotation[k] : position[k - 3]) += side == 0 ? kStep : -kStep;
      const Rigid moved = to_rigid(rotation, position).inverse();
      const Rigid turn{moved.rotation * X_BS.rotation.conjugate(), Eigen::Vector3d::Zero()};
      difference[side].head<3>() = rotation_vector(turn);
      difference[side].tail<3>() = moved.position - X_BS.position;
    }
    J.col(k) = (difference[0] - difference[1]) / (2 * kStep);
  }
  return J;
}

}  // namespace

Result<void> adjust(Problem& problem, double robust_px, double reject_sigmas, int iterations_max,
                    std::vector<double>& imager_sigma_px) {
  imager_sigma_px.assign(problem.imagers.size(), 1.0);
  if (auto ran = run(problem, imager_sigma_px, robust_px, iterations_max); !ran) return ran;
  if (reject_sigmas <= 0) return run(problem, imager_sigma_px, 0, iterations_max);
  // Twice: the first rejection uses a noise that the gross errors themselves still widen.
  for (int round = 0; round < 2; ++round) {
    imager_sigma_px = robust_sigmas(problem);
    reject_gross_errors(problem, imager_sigma_px, reject_sigmas);
    if (auto ran = run(problem, imager_sigma_px, 0, iterations_max); !ran) return ran;
  }
  return {};
}

Result<Adjustment> covariances(Problem& problem, const std::vector<double>& imager_sigma_px) {
  const Normal normal = normal_matrix(problem, imager_sigma_px);
  // Parameters that are estimated, and intrinsics that are held and only trusted to a stated sigma.
  std::vector<int> estimated, held;
  std::vector<double> held_variance;
  std::vector<int> where(static_cast<std::size_t>(normal.N.rows()), -1);
  const int first_intrinsics = normal.intrinsics_at.front();
  for (int i = 0; i < first_intrinsics; ++i) estimated.push_back(i);
  for (std::size_t i = 0; i < problem.imagers.size(); ++i) {
    const SensorSpec& spec = problem.spec(static_cast<int>(i));
    for (int k = 0; k < 9; ++k) {
      const int index = normal.intrinsics_at[i] + k;
      if (!spec.fix_intrinsics) {
        estimated.push_back(index);
        continue;
      }
      const double sigma =
          k < 2 ? spec.fixed_sigma_focal * (k == 0 ? problem.cameras[i].fx : problem.cameras[i].fy)
          : k < 4 ? spec.fixed_sigma_centre_px
                  : 0.0;
      if (sigma > 0) held.push_back(index), held_variance.push_back(sigma * sigma);
    }
  }
  for (std::size_t e = 0; e < estimated.size(); ++e)
    where[static_cast<std::size_t>(estimated[e])] = static_cast<int>(e);
  const Eigen::MatrixXd N = normal.N(estimated, estimated);
  // Scaled to a unit diagonal, so that metres, pixels and distortion coefficients weigh alike.
  const Eigen::VectorXd scale = N.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::LDLT<Eigen::MatrixXd> factor(scale.asDiagonal() * N * scale.asDiagonal());
  constexpr double kSingular = 1e-14;
  if (factor.info() != Eigen::Success || factor.rcond() < kSingular)
    return fail(
        "the views do not determine every camera: the normal matrix is singular; add views "
        "with the board tilted and shared between cameras");
  const auto solve_scaled = [&](const Eigen::MatrixXd& right) -> Eigen::MatrixXd {
    return scale.asDiagonal() * factor.solve(scale.asDiagonal() * right);
  };
  Eigen::MatrixXd C = solve_scaled(Eigen::MatrixXd::Identity(N.rows(), N.cols()));
  // What remains of the scale of the noise, after weighing each imager by its own.
  double sum = 0;
  Eigen::Index used = 0;
  for (const Observation& o : problem.observations) {
    if (!o.used) continue;
    const double sigma = imager_sigma_px[static_cast<std::size_t>(o.imager)];
    sum += residual_of(problem, o).squaredNorm() / (sigma * sigma);
    used += 2;
  }
  const auto freedom = std::max<Eigen::Index>(1, used - N.rows());
  const double variance_factor = sum / static_cast<double>(freedom);
  C *= variance_factor;
  if (!held.empty()) {
    // Held parameters are wrong by their stated sigma and pull the estimate by N^-1 N_held.
    const Eigen::MatrixXd pull = solve_scaled(normal.N(estimated, held));
    C += pull *
         Eigen::Map<const Eigen::VectorXd>(held_variance.data(),
                                           static_cast<Eigen::Index>(held.size()))
             .asDiagonal() *
         pull.transpose();
  }
  Adjustment result;
  double pooled = 0;
  for (std::size_t i = 0; i < problem.imagers.size(); ++i) {
    const Matrix6 J = pose_jacobian(problem.X_SB[i]);
    const int at = where[static_cast<std::size_t>(normal.imager_at[i])];
    result.covariance.push_back(J * C.block<6, 6>(at, at) * J.transpose());
    Eigen::Vector4d sigma;
    for (int k = 0; k < 4; ++k) {
      const int index = where[static_cast<std::size_t>(normal.intrinsics_at[i] + k)];
      const SensorSpec& spec = problem.spec(static_cast<int>(i));
      sigma[k] = index >= 0 ? std::sqrt(C(index, index))
                 : k < 2    ? spec.fixed_sigma_focal * problem.cameras[i].fx
                            : spec.fixed_sigma_centre_px;
    }
    result.sigma_intrinsics.push_back(sigma);
    result.imager_sigma_px.push_back(imager_sigma_px[i] * std::sqrt(variance_factor));
    pooled += result.imager_sigma_px.back() * result.imager_sigma_px.back();
  }
  result.sigma0_px = std::sqrt(pooled / static_cast<double>(problem.imagers.size()));
  return result;
}

std::vector<double> held_out_errors(const Problem& problem, double robust_px, int iterations_max) {
  // Every fourth corner of each view is hidden, the rest is adjusted, and the hidden ones judge it.
  // With many poses whole views are hidden instead: their boards are placed by half their corners.
  constexpr std::size_t kFold = 4;
  Problem hidden = problem;
  std::vector<std::size_t> judges;
  for (std::size_t i = 0; i < hidden.observations.size(); ++i) {
    if (!hidden.observations[i].used) continue;
    if ((static_cast<std::size_t>(hidden.observations[i].id) * 7 + 3) % kFold == 0) {
      hidden.observations[i].used = false;
      judges.push_back(i);
    }
  }
  std::vector<double> errors(problem.imagers.size(), 0.0);
  if (judges.size() < 8) return errors;
  if (!run(hidden, std::vector<double>(problem.imagers.size(), 1.0), robust_px, iterations_max))
    return errors;
  std::vector<double> count(problem.imagers.size(), 0.0);
  for (const std::size_t i : judges) {
    const Observation& o = hidden.observations[i];
    errors[static_cast<std::size_t>(o.imager)] += residual_of(hidden, o).squaredNorm();
    count[static_cast<std::size_t>(o.imager)] += 1;
  }
  for (std::size_t i = 0; i < errors.size(); ++i)
    errors[i] = count[i] > 0 ? std::sqrt(errors[i] / count[i]) : 0.0;
  return errors;
}

}  // namespace wagonsight::calibration
