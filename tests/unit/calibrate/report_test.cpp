// The report's numbers: the map of uncertainty against drawn errors, and what it says to do.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "calibrate/findings.h"
#include "calibrate/pack.h"
#include "calibrate/report.h"
#include "calibrate/uncertainty_map.h"
#include "support/synthetic_rig.h"

namespace wagonsight {
namespace {

using testing::HasSubstr;
using testing::Not;

RigSensor ceiling_sensor() {
  RigSensor sensor;
  sensor.name = "k0";
  sensor.camera.width = 640, sensor.camera.height = 480;
  sensor.camera.fx = sensor.camera.fy = 580, sensor.camera.cx = 319.5, sensor.camera.cy = 239.5;
  sensor.X_WS = {look_at({0, 0, 2.3}, {1.5, 0.4, 0.8}), {0, 0, 2.3}};
  Eigen::Matrix<double, 6, 6> A = Eigen::Matrix<double, 6, 6>::Zero();
  A.diagonal() << 0.002, 0.001, 0.003, 0.004, 0.002, 0.006;
  A(0, 4) = 0.001, A(3, 1) = 0.0015;
  sensor.covariance = A * A.transpose();
  return sensor;
}

TEST(UncertaintyMap, PropagatesAPoseAsDrawnErrorsDo) {
  const RigSensor sensor = ceiling_sensor();
  const Eigen::Vector3d p_W(1.4, 0.3, 1.0), p_S = sensor.X_WS.inverse() * p_W;
  const Eigen::Matrix<double, 6, 6> L = sensor.covariance.llt().matrixL();
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  Eigen::Matrix3d pose = Eigen::Matrix3d::Zero(), total = Eigen::Matrix3d::Zero();
  constexpr int kDraws = 40000;
  for (int i = 0; i < kDraws; ++i) {
    Eigen::Matrix<double, 6, 1> e;
    for (int k = 0; k < 6; ++k) e[k] = normal(random);
    e = L * e;
    const Eigen::Vector3d turn = e.head<3>();
    const Rigid X{Eigen::AngleAxisd(turn.norm(), turn.normalized()) * sensor.X_WS.rotation,
                  sensor.X_WS.position + e.tail<3>()};
    const Eigen::Vector3d off = X * p_S - p_W;
    pose += off * off.transpose() / kDraws;
    const double step = sensor.noise.step(p_S.z());
    std::uniform_real_distribution<double> within(-0.5, 0.5);
    const double z = p_S.z() + sensor.noise.sigma(p_S.z()) * normal(random) + step * within(random);
    const Eigen::Vector3d seen(z * p_S.x() / p_S.z() + p_S.z() / 580 * within(random),
                               z * p_S.y() / p_S.z() + p_S.z() / 580 * within(random), z);
    const Eigen::Vector3d moved = X * seen - p_W;
    total += moved * moved.transpose() / kDraws;
  }
  const PointCovariance told = point_covariance(sensor, p_W);
  EXPECT_LT((told.pose - pose).norm(), 0.03 * pose.norm());
  EXPECT_LT((told.total - total).norm(), 0.03 * total.norm());
}

TEST(UncertaintyMap, TakesTheBestSensorAndLeavesOutWhatNoneSees) {
  Rig rig;
  RigSensor good = ceiling_sensor(), poor = ceiling_sensor();
  poor.name = "k1";
  poor.covariance *= 100;
  rig.sensors.push_back(poor);
  rig.sensors.push_back(good);
  const UncertaintyMap map = map_uncertainty(rig);
  ASSERT_GT(map.cells.size(), 100U);
  int seen = 0;
  for (const auto& cell : map.cells) {
    if (cell.seen_by == 0) continue;
    ++seen;
    EXPECT_EQ(cell.best, 1);
    EXPECT_GE(cell.total_m, cell.pose_m);
  }
  EXPECT_GT(seen, 50);
  EXPECT_LT(seen, static_cast<int>(map.cells.size()));
  EXPECT_TRUE(map_uncertainty(Rig{}).cells.empty());
}

Result<Solution> solved(const synthetic::Options& options) {
  const auto rig = synthetic::make(3, options);
  return solve(rig.observations, rig.sensors);
}

TEST(Report, AGoodRigIsCalledGoodAndEveryPartIsThere) {
  synthetic::Options options;
  options.stereos = 1;
  options.poses = 30;
  const auto solution = solved(options);
  ASSERT_TRUE(solution) << solution.error().message;
  const std::string html = format_report(*solution, {{"none", "x"}}, "a <rig>");
  EXPECT_THAT(html, Not(HasSubstr("<rig>")));
  EXPECT_THAT(html, HasSubstr("a &lt;rig&gt;"));
  for (const char* part : {"The calibration ", "Cameras, worst first", "Views, worst first",
                           "Overlap", "Residuals in the images", "Coverage of the images",
                           "Georeference", "Where a point is placed", "<svg"})
    EXPECT_THAT(html, HasSubstr(part));
  EXPECT_THAT(html, Not(HasSubstr("nan")));
  EXPECT_THAT(html, Not(HasSubstr("http")));  // nothing is fetched
  EXPECT_EQ(html, format_report(*solution, {{"none", "x"}}, "a <rig>"));
}

TEST(Findings, NamesTheCameraTheViewAndThePlaceToPhotograph) {
  Solution solution;
  solution.board = {5, 7, 0.1};
  for (const char* name : {"k0", "k1"}) {
    ImagerSolution imager;
    imager.name = name;
    imager.camera.width = 640, imager.camera.height = 480;
    imager.camera.fx = imager.camera.fy = 580, imager.camera.cx = 320, imager.camera.cy = 240;
    imager.rms_px = 0.3, imager.corners = 100;
    imager.X_BS.position = {0.3, 0.2, -1.5};
    solution.imagers.push_back(imager);
  }
  solution.poses.push_back({"a", {}});
  solution.poses.push_back(
      {"b", {Eigen::Quaterniond(Eigen::AngleAxisd(1.3, Eigen::Vector3d::UnitX())), {}}});
  for (const char* pose : {"a", "b"}) {
    ViewSolution view;
    view.imager = "k0", view.image = std::string("k0/") + pose + ".png", view.pose = pose;
    view.rms_px = pose[0] == 'b' ? 2.41 : 0.3;
    view.residuals.push_back({3, {500, 400}, {0.1, 0.1}, true});
    solution.views.push_back(view);
  }
  EXPECT_NEAR(tilt_deg(solution, solution.views[0]), 0, 15);
  EXPECT_GT(tilt_deg(solution, solution.views[1]), 60);
  solution.imagers[0].rms_px = 1.3;
  const Findings findings = judge(solution, {});
  EXPECT_EQ(findings.grade, Grade::kPoor);
  EXPECT_THAT(findings.headline, HasSubstr("not good enough"));
  std::string all;
  for (const Finding& finding : findings.list)
    all += finding.what + " " + finding.what_to_do + "\n";
  EXPECT_THAT(all, HasSubstr("k0/b.png"));
  EXPECT_THAT(all, HasSubstr("less edge on"));
  EXPECT_THAT(all, HasSubstr("upper left"));
  EXPECT_THAT(all, HasSubstr("k1 hangs on 0 board poses"));
  EXPECT_EQ(findings.list.front().grade, Grade::kPoor);
  solution.imagers[0].rms_px = 0.3;
  EXPECT_LT(judge(solution, {}).grade, Grade::kPoor);
}

}  // namespace
}  // namespace wagonsight
