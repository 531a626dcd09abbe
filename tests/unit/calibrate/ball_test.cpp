#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

#include "calibrate/ball_centre.h"
#include "calibrate/markers.h"
#include "support/drawn_ball.h"

namespace wagonsight {
namespace {

const Camera kCamera{640, 480, 575, 576, 318, 242, {}};

TEST(BallCentre, UndoesThePerspectiveEccentricity) {
  double corrected = 0;
  const std::vector<Eigen::Vector3d> centres = {
      {0, 0, 1.5}, {0.5, 0.3, 1.0}, {-0.6, 0.35, 1.2}, {0.9, -0.6, 2.5}};
  for (const Eigen::Vector3d& centre : centres) {
    const auto found = ball_centre(kCamera, test::outline_of(kCamera, centre, 0.1), 0.1);
    ASSERT_TRUE(found);
    const Eigen::Vector2d expected = project(kCamera, centre).value();
    EXPECT_NEAR((found->pixel - expected).norm(), 0, 0.02) << centre.transpose();
    EXPECT_NEAR(found->distance_m.value(), centre.norm(), 0.01 * centre.norm());
    corrected = std::max(corrected, found->correction_px);
  }
  EXPECT_GT(corrected, 1.0) << "a near ball aside needs more than a pixel of correction";
}

TEST(SphereFit, FindsABallBeforeAWallOnATripodThroughNoise) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> uniform(0, 1);
  const DepthNoise noise;
  ImagerSolution imager;
  imager.name = "k0";
  imager.camera = kCamera;
  const double radius = 0.06;
  double normalised = 0;
  constexpr int kBalls = 20;
  for (int i = 0; i < kBalls; ++i) {
    const Eigen::Vector3d centre(0.6 * (uniform(random) - 0.5), 0.5 * (uniform(random) - 0.5),
                                 1.2 + 0.8 * uniform(random));
    const auto raw = test::depth_of_ball(kCamera, centre, radius, noise, random);
    const DepthImage image{raw.data(), 640, 480};
    const Eigen::Vector2d near = project(kCamera, centre).value() + Eigen::Vector2d(3, -4);
    const auto fit = fit_sphere(image, imager, near, radius);
    ASSERT_TRUE(fit) << fit.error().message;
    const Eigen::Vector3d error = fit->p_S - centre;
    EXPECT_LT(error.norm(), 0.004) << i;
    normalised += error.dot(fit->covariance.ldlt().solve(error)) / (3 * kBalls);
    // On the wall there is no ball.
    const auto wall = fit_sphere(image, imager, {30, 30}, radius);
    ASSERT_FALSE(wall);
    EXPECT_THAT(wall.error().message, testing::HasSubstr("is not that of a ball of 60 mm radius"));
  }
  const std::vector<std::uint16_t> dark(640 * 480, 0);
  const auto none = fit_sphere({dark.data(), 640, 480}, imager, {300, 200}, radius);
  ASSERT_FALSE(none);
  EXPECT_THAT(none.error().message, testing::HasSubstr("has no reading"));
  // The noise here is independent from pixel to pixel, a Kinect's is not: the covariance is meant
  // for that and must be wide here.
  EXPECT_LT(normalised, 1.2);
}

TEST(Markers, ReadsDtracksTextAndPlainJson) {
  const auto text = parse_markers(
      "fr 21753\nts 39596.024831\n6dcal 1\n"
      "6d 1 [0 1.000][326.848 -187.216 109.503 -160.4704 -3.6963 -7.0913][-0.940508 -0.340238 "
      "-0.004 0.2 0.3 0.4 0.5 0.6 0.7]\r\n"
      "3d 2 [79 1.000][210.730 -90.669 -108.554] [83 0.9][1000.0 2000.0 -3.5]\n"
      "fr 21754\n3d 1 [79 1.000][210.750 -90.669 -108.554]\n",
      "dtrack.txt");
  ASSERT_TRUE(text) << text.error().message;
  ASSERT_EQ(text->size(), 3U);
  EXPECT_NEAR(text->at("79").x(), 0.21074, 1e-9);
  EXPECT_NEAR(text->at("83").z(), -0.0035, 1e-12);
  EXPECT_NEAR(text->at("6d/0").y(), -0.187216, 1e-12);
  const auto json = parse_markers(R"({"A": [1, 2, 3.5]})", "markers.json");
  ASSERT_TRUE(json) << json.error().message;
  EXPECT_EQ(json->at("A"), Eigen::Vector3d(1, 2, 3.5));
}

TEST(Markers, SaysWhatIsWrong) {
  const auto message = [](const char* text) {
    return parse_markers(text, "m.txt").error().message;
  };
  EXPECT_EQ(message("fr 1\n"), "m.txt: it holds no marker: no \"3d\" or \"6d\" line of DTrack");
  EXPECT_EQ(message("fr 1\n3d 1 [79 1.0][210.7 -90.6]\n"),
            "m.txt:2: this is not [id quality][x y z] as DTrack writes it");
  EXPECT_EQ(message("3d 1 [7 1.0][0 0 0]\n3d 1 [7 1.0][0 0 12]\n"),
            "m.txt:2: marker 7 moved by 12.0 mm; record the targets standing still");
  EXPECT_EQ(message(R"({"A": [1, 2]})"), "m.txt: A must be three finite numbers in metres");
  EXPECT_EQ(message("{"), "m.txt: this is neither JSON {\"name\": [x, y, z]} nor DTrack's text");
}

}  // namespace
}  // namespace wagonsight
