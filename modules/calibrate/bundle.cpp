// Bundle adjustment with Ceres (the paper's equation 1). The only file that includes Ceres.
#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "calibrate/problem.h"
#include "calibrate/reprojection.h"

namespace wagonsight::calibration {
namespace {

// All corners of one view as one block of residuals, measured minus reprojected pixels in units of
// the imager's noise: what a view shares is computed once, and Ceres keeps 400 blocks, not 20,000.
// The Cauchy loss acts on each corner, so it is applied here (Ceres' own would act on the view): a
// residual r becomes r sqrt(rho(|r|^2)) / |r|, whose square is rho.
class ViewCost final : public ceres::CostFunction {
 public:
  ViewCost(double weight, double robust) : weight_(weight), robust_(robust) {
    *mutable_parameter_block_sizes() = {6, 6, 9};
  }
  void add(const Eigen::Vector3d& on_board, const Eigen::Vector2d& pixel) {
    corners_.push_back({on_board, pixel});
    set_num_residuals(2 * static_cast<int>(corners_.size()));
  }
  bool empty() const { return corners_.empty(); }

  bool Evaluate(const double* const* parameters, double* residuals,
                double** jacobians) const override {
    const ViewProjection projection(parameters[0], parameters[1], parameters[2]);
    PixelJacobians J;
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      Eigen::Vector2d pixel;
      if (!projection.project(corners_[i].on_board, pixel, jacobians == nullptr ? nullptr : &J))
        return false;
      Eigen::Vector2d r = weight_ * (corners_[i].pixel - pixel);
      Eigen::Matrix2d chain = -weight_ * Eigen::Matrix2d::Identity();
      if (robust_ > 0) make_robust(r, chain);
      Eigen::Map<Eigen::Vector2d>(residuals + 2 * i) = r;
      if (jacobians == nullptr) continue;
      put<6>(jacobians[0], i, chain * J.X_SB);
      put<6>(jacobians[1], i, chain * J.X_BP);
      put<9>(jacobians[2], i, chain * J.intrinsics);
    }
    return true;
  }

 private:
  struct Seen {
    Eigen::Vector3d on_board;
    Eigen::Vector2d pixel;
  };

  template <int N>
  static void put(double* block, std::size_t corner, const Eigen::Matrix<double, 2, N>& rows) {
    using RowMajor = Eigen::Matrix<double, 2, N, Eigen::RowMajor>;
    if (block != nullptr) Eigen::Map<RowMajor>(block + 2 * N * corner) = rows;
  }

  void make_robust(Eigen::Vector2d& r, Eigen::Matrix2d& chain) const {
    const double c2 = robust_ * robust_, s = r.squaredNorm();
    // scale(s) = sqrt(c2 log(1 + s / c2) / s) and its derivative; a series where s is small.
    double scale = 1 - s / (4 * c2), slope = -1 / (4 * c2);
    if (s > 1e-6 * c2) {
      const double rho = c2 * std::log1p(s / c2);
      scale = std::sqrt(rho / s);
      slope = (1 / (1 + s / c2) - rho / s) / (2 * s * scale);
    }
    const Eigen::Matrix2d bend =
        scale * Eigen::Matrix2d::Identity() + 2 * slope * r * r.transpose();
    chain = bend * chain;
    r *= scale;
  }

  double weight_, robust_;
  std::vector<Seen> corners_;
};

struct DistortionPrior {
  template <class T>
  bool operator()(const T* k, T* residual) const {
    for (std::size_t i = 0; i < kDistortionSigma.size(); ++i)
      residual[i] = k[4 + i] / kDistortionSigma[i];
    return true;
  }
};

struct BaselinePrior {
  double baseline, sigma;
  template <class T>
  bool operator()(const T* left, const T* right, T* residual) const {
    // The right centre in the left imager: |R_l (c_r - c_l)| = |c_r - c_l|, c = -R^T t.
    T centre[2][3], distance2 = T(0);
    const T* blocks[2] = {left, right};
    for (int side = 0; side < 2; ++side) {
      const T back[3] = {-blocks[side][0], -blocks[side][1], -blocks[side][2]};
      ceres::AngleAxisRotatePoint(back, blocks[side] + 3, centre[side]);
    }
    for (int i = 0; i < 3; ++i) {
      const T d = centre[0][i] - centre[1][i];
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
    for (const Rigid& X : problem.X_SB) X_SB.push_back(to_block(X));
    for (const Rigid& X : problem.X_BP) X_BP.push_back(to_block(X));
    for (const Camera& c : problem.cameras) intrinsics.push_back(to_block(c));
  }
  void write_to(Problem& problem) const {
    for (std::size_t i = 0; i < X_SB.size(); ++i) problem.X_SB[i] = to_rigid(X_SB[i]);
    for (std::size_t i = 0; i < X_BP.size(); ++i) problem.X_BP[i] = to_rigid(X_BP[i]);
    for (std::size_t i = 0; i < intrinsics.size(); ++i)
      write_intrinsics(intrinsics[i], problem.cameras[i]);
  }
};

void add_views(const Problem& problem, Blocks& blocks, const std::vector<double>& sigma_px,
               double robust_px, ceres::Problem& adjustment) {
  std::vector<std::unique_ptr<ViewCost>> costs(problem.views.size());
  for (std::size_t v = 0; v < costs.size(); ++v) {
    const double sigma = sigma_px[static_cast<std::size_t>(problem.view_imager[v])];
    costs[v] = std::make_unique<ViewCost>(1.0 / sigma, robust_px / sigma);
  }
  for (const Observation& o : problem.observations)
    if (o.used) costs[static_cast<std::size_t>(o.view)]->add(problem.board.point(o.id), o.pixel);
  for (std::size_t v = 0; v < costs.size(); ++v) {
    if (costs[v]->empty()) continue;
    const auto imager = static_cast<std::size_t>(problem.view_imager[v]);
    const auto pose = static_cast<std::size_t>(problem.view_pose[v]);
    adjustment.AddResidualBlock(costs[v].release(), nullptr, blocks.X_SB[imager].data(),
                                blocks.X_BP[pose].data(), blocks.intrinsics[imager].data());
  }
}

void add_what_is_known(const Problem& problem, Blocks& blocks, ceres::Problem& adjustment) {
  const auto reference = static_cast<std::size_t>(problem.reference_pose);
  if (adjustment.HasParameterBlock(blocks.X_BP[reference].data()))
    adjustment.SetParameterBlockConstant(blocks.X_BP[reference].data());
  for (std::size_t i = 0; i < blocks.intrinsics.size(); ++i) {
    double* block = blocks.intrinsics[i].data();
    if (!adjustment.HasParameterBlock(block)) continue;
    if (problem.spec(static_cast<int>(i)).fix_intrinsics)
      adjustment.SetParameterBlockConstant(block);
    else
      adjustment.AddResidualBlock(
          new ceres::AutoDiffCostFunction<DistortionPrior, 5, 9>(new DistortionPrior), nullptr,
          block);
  }
  for (const KnownBaseline& known : known_baselines(problem))
    adjustment.AddResidualBlock(new ceres::AutoDiffCostFunction<BaselinePrior, 1, 6, 6>(
                                    new BaselinePrior{known.baseline_m, known.sigma_m}),
                                nullptr, blocks.X_SB[known.left].data(),
                                blocks.X_SB[known.right].data());
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
  std::vector<int> left(problem.pose_names.size(), 0);
  for (Observation& o : problem.observations) {
    o.used = residual_of(problem, o).norm() < sigmas * sigma_px[static_cast<std::size_t>(o.imager)];
    if (o.used) ++left[static_cast<std::size_t>(o.pose)];
  }
  // Fewer corners fix no board pose.
  constexpr int kCornersMin = 4;
  for (Observation& o : problem.observations)
    if (left[static_cast<std::size_t>(o.pose)] < kCornersMin) o.used = false;
}

}  // namespace

std::vector<KnownBaseline> known_baselines(const Problem& problem) {
  std::vector<KnownBaseline> known;
  for (std::size_t i = 0; i + 1 < problem.imagers.size(); ++i) {
    const SensorSpec& spec = problem.spec(static_cast<int>(i));
    if (spec.baseline_m && problem.imagers[i].sensor_index == problem.imagers[i + 1].sensor_index)
      known.push_back({i, i + 1, *spec.baseline_m, spec.baseline_sigma_m});
  }
  return known;
}

Eigen::Vector2d residual_of(const Problem& problem, const Observation& o) {
  const Rigid X_SP = problem.X_SB[static_cast<std::size_t>(o.imager)] *
                     problem.X_BP[static_cast<std::size_t>(o.pose)];
  return o.pixel - reproject(problem, o.imager, X_SP, o.id);
}

Result<void> run(Problem& problem, const std::vector<double>& sigma_px, const RunOptions& how) {
  Blocks blocks(problem);
  ceres::Problem adjustment;
  add_views(problem, blocks, sigma_px, how.robust_px, adjustment);
  add_what_is_known(problem, blocks, adjustment);
  ceres::Solver::Options options;
  // Board poses are eliminated first: what is left is 15 unknowns an imager, a small dense system.
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = how.iterations_max;
  options.function_tolerance = how.tolerance;
  options.gradient_tolerance = 1e-12;
  options.parameter_tolerance = 1e-12;
  options.num_threads = 1;  // sums in one order: the same input gives the same output
  options.logging_type = ceres::SILENT;
  auto* order = new ceres::ParameterBlockOrdering;
  const auto put = [&](auto& list, int group) {
    for (auto& block : list)
      if (adjustment.HasParameterBlock(block.data())) order->AddElementToGroup(block.data(), group);
  };
  put(blocks.X_BP, 0);
  put(blocks.X_SB, 1);
  put(blocks.intrinsics, 1);
  options.linear_solver_ordering.reset(order);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &adjustment, &summary);
  if (!summary.IsSolutionUsable())
    return fail(fmt::format("the bundle adjustment failed: {}", summary.message));
  blocks.write_to(problem);
  return {};
}

Result<void> adjust(Problem& problem, double robust_px, double reject_sigmas, int iterations_max,
                    std::vector<double>& imager_sigma_px) {
  imager_sigma_px.assign(problem.imagers.size(), 1.0);
  const RunOptions to_the_end{0, iterations_max, 1e-10};
  // Only tells good corners from bad ones, so it need not converge to the last digit.
  if (auto ran = run(problem, imager_sigma_px, {robust_px, iterations_max, 1e-5}); !ran) return ran;
  if (reject_sigmas <= 0) return run(problem, imager_sigma_px, to_the_end);
  // Twice: the first rejection uses a noise that the gross errors themselves still widen.
  for (int round = 0; round < 2; ++round) {
    imager_sigma_px = robust_sigmas(problem);
    reject_gross_errors(problem, imager_sigma_px, reject_sigmas);
    if (auto ran = run(problem, imager_sigma_px, to_the_end); !ran) return ran;
  }
  return {};
}

}  // namespace wagonsight::calibration
