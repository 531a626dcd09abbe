#include "calibrate/georeference.h"

#include <gtest/gtest.h>

#include "geometry/angles.h"
#include "support/synthetic_rig.h"

namespace wagonsight {
namespace {

std::vector<Target> targets_at(const synthetic::RigWithTruth& rig, const Similarity& X_WB,
                               const std::vector<Eigen::Vector3d>& points_B) {
  std::vector<Target> targets;
  const auto imagers = imagers_of(rig.sensors);
  for (const Eigen::Vector3d& p_B : points_B) {
    Target target;
    target.id = "T" + std::to_string(targets.size());
    target.world = X_WB * p_B;
    for (std::size_t i = 0; i < imagers.size(); ++i)
      if (const auto pixel = project(rig.cameras[i], rig.X_BS[i].inverse() * p_B))
        target.seen.push_back({imagers[i].name, *pixel, {}, {}});
    targets.push_back(target);
  }
  return targets;
}

TEST(Georeference, RecoversTheSimilarityAndItsScale) {
  const auto rig = synthetic::make(1, {.poses = 2, .stereos = 0});
  Solution solution = synthetic::true_solution(rig);
  // The angles of the paper's Table 3, and its stereo cameras' scale.
  constexpr double kRad = 3.14159265358979 / 180;
  const Similarity X_WB{
      1.03, from_omega_phi_kappa({-179.5 * kRad, 0.6 * kRad, -92.16 * kRad}), {0.99, 2.51, 0.003}};
  const auto targets = targets_at(
      rig, X_WB, {{0.2, 0.1, -0.3}, {0.7, 0.2, -0.5}, {0.1, 0.8, -0.7}, {0.6, 0.7, -0.4}});
  const auto done = georeference(targets, solution);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_NEAR(solution.georeference->X_WB.scale, 1.03, 1e-6);
  EXPECT_NEAR((solution.georeference->X_WB.position - X_WB.position).norm(), 0, 1e-6);
  EXPECT_NEAR(to_omega_phi_kappa(solution.georeference->X_WB.rotation).omega / kRad, -179.5, 1e-4);
  for (const auto& residual : solution.georeference->residuals_m) EXPECT_LT(residual.norm(), 1e-6);
  EXPECT_GT(solution.georeference->covariance(6, 6), 0);
}

TEST(Georeference, RefusesTooFewAndCollinearTargets) {
  const auto rig = synthetic::make(1, {.poses = 2, .stereos = 0});
  Solution solution = synthetic::true_solution(rig);
  auto two = targets_at(rig, {}, {{0, 0, 0}, {1, 0, 0}});
  const auto few = georeference(two, solution);
  ASSERT_FALSE(few);
  EXPECT_EQ(few.error().message,
            "2 targets cannot fix the seven parameters of the georeference; measure at least three "
            "that are not on one line");
  auto line = targets_at(rig, {}, {{0, 0, -0.3}, {0.3, 0, -0.3}, {0.6, 0, -0.3}});
  const auto collinear = georeference(line, solution);
  ASSERT_FALSE(collinear);
  EXPECT_NE(collinear.error().message.find("on one line"), std::string::npos);
}

TEST(Georeference, NamesATargetThatOneImagerSees) {
  const auto rig = synthetic::make(1, {.poses = 2, .stereos = 0});
  Solution solution = synthetic::true_solution(rig);
  auto targets = targets_at(rig, {}, {{0.2, 0.1, -0.3}, {0.7, 0.2, -0.5}, {0.1, 0.8, -0.7}});
  targets[1].seen.resize(1);
  const auto done = georeference(targets, solution);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().message,
            "target T1: it must be seen by at least two imagers from directions more than 0.5 "
            "degrees apart");
}

TEST(Georeference, SurvivesAWayThroughItsFile) {
  const auto rig = synthetic::make(7, {.poses = 5, .kinects = 3, .stereos = 1});
  auto solution = solve(rig.observations, rig.sensors);
  ASSERT_TRUE(solution) << solution.error().message;
  const auto targets = targets_at(rig, {}, {{0.2, 0.1, -0.3}, {0.7, 0.2, -0.5}, {0.1, 0.8, -0.7}});
  ASSERT_TRUE(georeference(targets, *solution));
  const std::string text = format_solution(*solution);
  const auto back = parse_solution(text, "SOLUTION.json");
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(back->imagers.size(), solution->imagers.size());
  EXPECT_NEAR(back->georeference->X_WB.scale, solution->georeference->X_WB.scale, 1e-15);
  EXPECT_EQ(back->views.size(), solution->views.size());
}

}  // namespace
}  // namespace wagonsight
