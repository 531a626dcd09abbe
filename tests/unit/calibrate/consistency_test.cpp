// Are the covariances that a solution reports what the errors really do, and could anybody estimate
// better from the same corners? The short form runs with every test; the long one, 100 seeds of the
// paper's whole rig, with WAGONSIGHT_LONG_PROOF=1.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cstdlib>

#include "support/synthetic_rig.h"

namespace wagonsight {
namespace {

bool is_long() {
  return std::getenv("WAGONSIGHT_LONG_PROOF") != nullptr;
}

using Vector6 = Eigen::Matrix<double, 6, 1>;

// Rotation in B and position in B by which an estimate is off.
Vector6 error_of(const Rigid& estimate, const Rigid& truth) {
  const Eigen::AngleAxisd turn(estimate.rotation * truth.rotation.conjugate());
  Vector6 error;
  error << turn.angle() * turn.axis(), estimate.position - truth.position;
  return error;
}

Eigen::VectorXd errors_of(const Solution& solution, const synthetic::RigWithTruth& rig) {
  Eigen::VectorXd errors(6 * static_cast<Eigen::Index>(rig.X_BS.size()));
  for (std::size_t i = 0; i < rig.X_BS.size(); ++i)
    errors.segment<6>(6 * static_cast<Eigen::Index>(i)) =
        error_of(solution.imagers[i].X_BS, rig.X_BS[i]);
  return errors;
}

// The central 95% of chi-square with k degrees of freedom (Wilson and Hilferty 1931).
std::pair<double, double> chi_square_95(double k) {
  const double spread = 1.959964 * std::sqrt(2 / (9 * k)), middle = 1 - 2 / (9 * k);
  return {k * std::pow(middle - spread, 3), k * std::pow(middle + spread, 3)};
}

Rigid moved(const Rigid& X, int parameter, double step) {
  Rigid result = X;
  if (parameter < 3)
    result.rotation =
        Eigen::Quaterniond(Eigen::AngleAxisd(step, Eigen::Vector3d::Unit(parameter))) * X.rotation;
  else
    result.position[parameter - 3] += step;
  return result;
}

// The Cramer-Rao bound of all X_BS at the truth: the inverse of the Fisher information of the
// corners that were seen, by central differences of the camera model alone. It shares no line with
// the solver. Kinects' intrinsics are known; a stereo lens has nine unknowns.
Eigen::MatrixXd cramer_rao(const synthetic::RigWithTruth& rig, double noise_px) {
  const auto imagers = imagers_of(rig.sensors);
  const auto n = static_cast<int>(imagers.size());
  std::vector<int> lens_at(imagers.size(), -1);
  int rows = 6 * n + 6 * (static_cast<int>(rig.X_BP.size()) - 1);
  for (std::size_t i = 0; i < imagers.size(); ++i)
    if (!rig.sensors[static_cast<std::size_t>(imagers[i].sensor_index)].fix_intrinsics)
      lens_at[i] = rows, rows += 9;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(rows, rows);
  for (const View& view : rig.observations.views) {
    std::size_t i = 0;
    while (imagers[i].name != view.imager) ++i;
    const auto pose = static_cast<std::size_t>(std::stoi(view.pose.substr(1)));
    std::vector<int> at;
    for (int k = 0; k < 6; ++k) at.push_back(6 * static_cast<int>(i) + k);
    if (pose > 0)
      for (int k = 0; k < 6; ++k) at.push_back(6 * n + 6 * (static_cast<int>(pose) - 1) + k);
    const std::size_t lens_from = at.size();
    if (lens_at[i] >= 0)
      for (int k = 0; k < 9; ++k) at.push_back(lens_at[i] + k);
    for (const Corner& corner : view.corners) {
      const Eigen::Vector3d p_P = rig.observations.board.point(corner.id);
      Eigen::Matrix2Xd J(2, static_cast<Eigen::Index>(at.size()));
      for (std::size_t a = 0; a < at.size(); ++a) {
        Eigen::Vector2d pixel[2];
        const bool is_lens = a >= lens_from;
        const double step = is_lens && a < lens_from + 4 ? 1e-3 : 1e-6;
        for (int side = 0; side < 2; ++side) {
          const double d = side == 0 ? step : -step;
          Camera camera = rig.cameras[i];
          Rigid X_BS = rig.X_BS[i], X_BP = rig.X_BP[pose];
          if (is_lens) {
            const std::size_t k = a - lens_from;
            double* const values[] = {&camera.fx, &camera.fy, &camera.cx, &camera.cy};
            (k < 4 ? *values[k] : camera.distortion[k - 4]) += d;
          } else if (a < 6) {
            X_BS = moved(X_BS, static_cast<int>(a), d);
          } else {
            X_BP = moved(X_BP, static_cast<int>(a) - 6, d);
          }
          pixel[side] = project(camera, X_BS.inverse() * (X_BP * p_P)).value();
        }
        J.col(static_cast<Eigen::Index>(a)) = (pixel[0] - pixel[1]) / (2 * step * noise_px);
      }
      const Eigen::MatrixXd own = J.transpose() * J;
      for (std::size_t a = 0; a < at.size(); ++a)
        for (std::size_t b = 0; b < at.size(); ++b)
          information(at[a], at[b]) +=
              own(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b));
    }
  }
  const Eigen::VectorXd scale = information.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
  const Eigen::MatrixXd bound = scale.asDiagonal() *
                                scaled.ldlt().solve(Eigen::MatrixXd::Identity(rows, rows)) *
                                scale.asDiagonal();
  return bound.topLeftCorner(6 * n, 6 * n);
}

struct Case {
  const char* name;
  synthetic::Options options;
};

class Consistency : public testing::TestWithParam<Case> {};

TEST_P(Consistency, ErrorsAreWhatTheCovarianceSays) {
  synthetic::Options options = GetParam().options;
  const unsigned seeds = is_long() ? 100 : 8;
  if (!is_long()) options.poses = 8, options.stereos = std::min(options.stereos, 2);
  double sum = 0, freedom = 0;
  std::vector<double> by_imager;
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    const auto rig = synthetic::make(seed, options);
    const auto solution = solve(rig.observations, rig.sensors, {.hold_out = false});
    ASSERT_TRUE(solution) << solution.error().message;
    ASSERT_EQ(solution->reference_pose, "p0");
    const Eigen::VectorXd error = errors_of(*solution, rig);
    sum += error.dot(solution->joint_covariance.ldlt().solve(error));
    freedom += static_cast<double>(error.size());
    by_imager.resize(rig.X_BS.size());
    for (std::size_t i = 0; i < by_imager.size(); ++i) {
      const Vector6 own = error.segment<6>(6 * static_cast<Eigen::Index>(i));
      by_imager[i] += own.dot(solution->imagers[i].covariance.ldlt().solve(own)) / seeds;
    }
  }
  const auto [low, high] = chi_square_95(freedom);
  std::string told;
  for (const double nees : by_imager) told += " " + std::to_string(nees).substr(0, 4);
  std::printf("%s: NEES %.4f of 1, 95%% from %.4f to %.4f; by imager, of 6:%s\n", GetParam().name,
              sum / freedom, low / freedom, high / freedom, told.c_str());
  EXPECT_GT(sum, low);
  EXPECT_LT(sum, high);
}

INSTANTIATE_TEST_SUITE_P(
    Rigs, Consistency,
    testing::Values(
        Case{"quarter_pixel", {.noise_px = 0.25, .poses = 20, .start_values = true}},
        Case{"half_pixel", {.noise_px = 0.5, .poses = 20, .start_values = true}},
        Case{"gross_errors",
             {.noise_px = 0.25, .gross_share = 0.05, .poses = 20, .start_values = true}},
        Case{"flat_view", {.noise_px = 0.25, .poses = 20, .start_values = true, .flat_view = true}},
        Case{"stated_intrinsics",
             {.noise_px = 0.25,
              .poses = 20,
              .focal_sigma = 0.001,
              .centre_sigma_px = 0.3,
              .start_values = true}}),
    [](const auto& parameter) { return std::string(parameter.param.name); });

TEST(Efficiency, IsWithinFifteenPercentOfTheCramerRaoBound) {
  const unsigned seeds = is_long() ? 100 : 8;
  for (const double noise_px : {0.25, 0.5}) {
    double pooled = 0, count = 0;
    for (unsigned seed = 1; seed <= seeds; ++seed) {
      const auto rig = synthetic::make(seed, {.noise_px = noise_px,
                                              .poses = is_long() ? 20 : 8,
                                              .stereos = is_long() ? 6 : 2,
                                              .start_values = true,
                                              .flat_view = true});
      const auto solution = solve(rig.observations, rig.sensors, {.hold_out = false});
      ASSERT_TRUE(solution) << solution.error().message;
      const Eigen::VectorXd bound = cramer_rao(rig, noise_px).diagonal();
      const Eigen::VectorXd error = errors_of(*solution, rig);
      pooled += (error.array().square() / bound.array()).sum();
      count += static_cast<double>(error.size());
    }
    const double ratio = std::sqrt(pooled / count);
    std::printf("noise %.2f px: RMS error %.3f of the Cramer-Rao bound's\n", noise_px, ratio);
    EXPECT_LT(ratio, 1.15);
    EXPECT_GT(ratio, 0.8) << "better than the bound: the bound is wrong";
  }
}

}  // namespace
}  // namespace wagonsight
