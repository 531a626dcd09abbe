#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <filesystem>
#include <numbers>
#include <opencv2/imgcodecs.hpp>

#include "calibrate/detect_board.h"
#include "calibrate/solve.h"

namespace wagonsight {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

// Two real Kinects, 16 pairs; the numbers were published with them.
TEST(RecordedPair, StandsWhereThePublishedCalibrationHasIt) {
  const std::string folder = WAGONSIGHT_SOURCE_DIR "/../shared/data/kinect_pair_boards";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "the recorded boards are not here";
  Observations observations;
  observations.board = {7, 10, 0.03};
  int detected = 0, whole = 0;
  for (const char* side : {"left", "right"})
    for (int number = 0; number < 16; ++number) {
      const std::string path = fmt::format("{}/{}/{:02d}.png", folder, side, number);
      const cv::Mat image = cv::imread(path, cv::IMREAD_GRAYSCALE);
      ASSERT_FALSE(image.empty()) << path;
      const auto found = detect_board({image.data, image.cols, image.rows}, observations.board);
      if (!found) continue;
      ++detected;
      whole += found->whole ? 1 : 0;
      View view;
      view.imager = side;
      view.image = path;
      view.pose = fmt::format("{:02d}", number);
      view.corners = found->corners;
      view.placed = found->placed;
      observations.views.push_back(view);
    }
  EXPECT_EQ(detected, 32);
  EXPECT_GE(whole, 28);

  std::vector<SensorSpec> sensors(2);
  sensors[0].name = "left";
  sensors[1].name = "right";
  for (SensorSpec& sensor : sensors) {
    sensor.width = 640;
    sensor.height = 480;
  }
  const auto solution = solve(observations, sensors);
  ASSERT_TRUE(solution) << solution.error().message;
  ASSERT_EQ(solution->imagers.size(), 2U);
  for (const ImagerSolution& imager : solution->imagers)
    EXPECT_LE(imager.rms_px_per_coordinate, 0.30) << imager.name;

  const Rigid X_RL = solution->imagers[1].X_BS.inverse() * solution->imagers[0].X_BS;
  const Eigen::Vector3d published_T(0.32068, 0.00791, 0.15696);
  const Eigen::Vector3d published_turn(-0.0177, -0.8991, 0.0444);
  EXPECT_LT((X_RL.position - published_T).norm(), 0.002) << X_RL.position.transpose();
  const Eigen::Quaterniond published(
      Eigen::AngleAxisd(published_turn.norm(), published_turn.normalized()));
  EXPECT_LT(published.angularDistance(X_RL.rotation) * kDegrees, 0.5);
}

}  // namespace
}  // namespace wagonsight
