#include "people/motion.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <Eigen/Eigenvalues>
#include <random>

namespace wagonsight {
namespace {

TEST(MotionFilter, FindsTheVelocityOfAWalk) {
  MotionFilter filter({0, 0}, 0.05);
  for (int i = 1; i <= 60; ++i) {
    filter.predict(1.0 / 30, 1.6);
    filter.correct({1.2 * i / 30.0, -0.4 * i / 30.0}, 0.05);
  }
  EXPECT_NEAR(filter.velocity().x(), 1.2, 0.05);
  EXPECT_NEAR(filter.velocity().y(), -0.4, 0.05);
  EXPECT_NEAR(filter.position().x(), 2.4, 0.03);
}

TEST(MotionFilter, FollowsWhoMovesFasterThanTheStatedRateSuggests) {
  // Half a metre between frames that claim to be a thirtieth of a second apart.
  MotionFilter filter({0, 0}, 0.05);
  for (int i = 1; i <= 8; ++i) {
    filter.predict(1.0 / 30, 1.6);
    filter.correct({0.5 * i, 0}, 0.05);
    EXPECT_NEAR(filter.position().x(), 0.5 * i, 0.25) << "step " << i;
  }
}

TEST(MotionFilter, IsAsSureAsItIsRight) {
  // The mean of the squared Mahalanobis distance of its own model's measurements is 2.
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  double sum = 0;
  int count = 0;
  for (int run = 0; run < 200; ++run) {
    const double dt = 0.1;
    const double acceleration = 1.6;
    Eigen::Vector2d position(0, 0);
    Eigen::Vector2d velocity(1.5 * normal(random), 1.5 * normal(random));
    const Eigen::Vector2d noise(0.05 * normal(random), 0.05 * normal(random));
    MotionFilter filter(position + noise, 0.05);
    for (int i = 0; i < 30; ++i) {
      for (int part = 0; part < 20; ++part) {  // white noise in small steps
        const double h = dt / 20;
        velocity += acceleration * std::sqrt(h) * Eigen::Vector2d(normal(random), normal(random));
        position += h * velocity;
      }
      filter.predict(dt, acceleration);
      const Eigen::Vector2d seen =
          position + 0.05 * Eigen::Vector2d(normal(random), normal(random));
      sum += filter.distance2(seen, 0.05);
      ++count;
      filter.correct(seen, 0.05);
    }
  }
  EXPECT_NEAR(sum / count, 2.0, 0.15);
}

TEST(MotionFilter, KeepsItsCovarianceSymmetricAndPositive) {
  EXPECT_TRUE(rc::check([] {
    MotionFilter filter({0, 0}, 0.05);
    const auto steps = *rc::gen::container<std::vector<int>>(rc::gen::inRange(0, 4000));
    for (const int step : steps) {
      filter.predict(1e-3 * (step % 500), 1.6);
      if (step % 3 != 0) filter.correct({1e-3 * step, -2e-3 * step}, 0.02 + 1e-4 * (step % 700));
      const Eigen::Matrix4d P = filter.covariance();
      RC_ASSERT((P - P.transpose()).norm() < 1e-9 * (1 + P.norm()));
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> solver(P);
      RC_ASSERT(solver.eigenvalues().minCoeff() > 0);
    }
  }));
}

}  // namespace
}  // namespace wagonsight
