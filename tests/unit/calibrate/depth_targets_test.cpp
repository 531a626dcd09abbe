#include "calibrate/depth_targets.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "support/drawn_ball.h"

namespace wagonsight {
namespace {

const Camera kColour{640, 480, 525, 526, 320, 240, {}};
const Camera kDepth{640, 480, 575, 576, 318, 242, {}};
constexpr double kRadius = 0.06;

// A Kinect whose depth camera is calibrated: it reads 1% short, and 8 mm beside.
Solution one_kinect() {
  ImagerSolution imager;
  imager.name = "k0";
  imager.camera = kColour;
  DepthCalibration depth;
  depth.camera = kDepth;
  depth.X_CS = Rigid{Eigen::Quaterniond(Eigen::AngleAxisd(0.01, Eigen::Vector3d::UnitY())),
                     Eigen::Vector3d(-0.025, 0.001, 0.002)};
  depth.scale = 1.01;
  depth.offset_m = 0.008;
  imager.depth = depth;
  Solution solution;
  solution.imagers = {imager};
  return solution;
}

struct Ball {
  Eigen::Vector3d p_S;
  Target target;
  std::vector<std::uint16_t> depth;

  explicit Ball(const Solution& solution, const Eigen::Vector3d& at_S, unsigned seed) : p_S(at_S) {
    const DepthCalibration& calibrated = *solution.imagers[0].depth;
    const Eigen::Vector3d p_C = calibrated.X_CS * p_S;
    target.id = "A";
    target.seen.push_back({"k0", project(kColour, p_C).value(), "k0/01.png",
                           test::outline_of(kColour, p_C, kRadius)});
    std::mt19937 random(seed);
    depth = test::depth_of_ball(kDepth, p_S, kRadius, {}, random);
    for (std::uint16_t& reading : depth)
      if (reading != 0)
        reading = static_cast<std::uint16_t>(
            std::lround((1e-3 * reading - calibrated.offset_m) / calibrated.scale * 1e3));
  }
  DepthImage image() const { return {depth.data(), kDepth.width, kDepth.height}; }
  Result<DepthTarget> fit(const Solution& solution, double radius = kRadius) const {
    return sphere_in_depth(solution, target, target.seen[0], image(), radius);
  }
};

TEST(SphereInDepth, FindsTheClickedBallThroughTheDepthCalibration) {
  const Solution solution = one_kinect();
  unsigned seed = 1;
  for (const Eigen::Vector3d& at : {Eigen::Vector3d(0, 0, 1.5), Eigen::Vector3d(0.4, -0.2, 1.2),
                                    Eigen::Vector3d(-0.5, 0.1, 2)}) {
    const Ball ball(solution, at, seed++);
    const auto found = ball.fit(solution);
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_EQ(found->sphere.imager, "k0");
    EXPECT_LT((found->sphere.p_S - at).norm(), 0.004) << at.transpose();
    EXPECT_GT(found->readings, 100);
    EXPECT_GT(found->sphere.sigma_m, 0);
    EXPECT_LT(found->sphere.sigma_m, 0.01);
  }
}

TEST(SphereInDepth, HoldsTheCalibrationsUncertainty) {
  Solution solution = one_kinect();
  const Ball ball(solution, {0.1, 0, 1.5}, 3);
  const double sure = ball.fit(solution)->sphere.sigma_m;
  constexpr double kOffsetSigma = 0.012;
  solution.imagers[0].depth->covariance(7, 7) = kOffsetSigma * kOffsetSigma;
  // One direction of three is uncertain by so much.
  EXPECT_NEAR(ball.fit(solution)->sphere.sigma_m, std::hypot(sure, kOffsetSigma / std::sqrt(3.0)),
              3e-4);
}

TEST(SphereInDepth, SaysWhyThereIsNone) {
  Solution solution = one_kinect();
  const Ball ball(solution, {0, 0, 1.5}, 5);
  const auto message = [&](const Result<DepthTarget>& result) {
    return result ? std::string("found") : result.error().message;
  };
  EXPECT_THAT(message(ball.fit(solution, 0.09)), testing::HasSubstr("mm radius"));

  Target elsewhere = ball.target;  // a click on the wall, where the outline was taken for a ball
  elsewhere.seen[0].pixel += Eigen::Vector2d(120, 60);
  EXPECT_THAT(
      message(sphere_in_depth(solution, elsewhere, elsewhere.seen[0], ball.image(), kRadius)),
      testing::HasSubstr("is not that of a ball of 60 mm radius"));

  Target bare = ball.target;
  bare.seen[0].outline.reset();
  EXPECT_EQ(message(sphere_in_depth(solution, bare, bare.seen[0], ball.image(), kRadius)),
            "k0: how far away the ball is cannot be told; click on it with its outline, or in "
            "another image too");

  EXPECT_EQ(message(sphere_in_depth(solution, ball.target, ball.target.seen[0],
                                    {ball.depth.data(), 320, 240}, kRadius)),
            "k0: its depth image has 320 x 240 pixels, its depth camera 640 x 480");
  solution.imagers[0].depth.reset();
  EXPECT_EQ(message(ball.fit(solution)),
            "k0: its depth camera is not calibrated; solve with the depth images");
  solution.imagers[0].name = "k9";
  EXPECT_EQ(message(ball.fit(solution)), "\"k0\" is not in the solution");
}

}  // namespace
}  // namespace wagonsight
