#include "pipeline/seen_share.h"

#include <gtest/gtest.h>

#include "geometry/angles.h"

namespace wagonsight {
namespace {

// A sensor at 1 m height that looks along +x at a box of 0.4 x 0.4 x 1.6 m whose front is 2.8 m
// away.
class SeenShare : public ::testing::Test {
 protected:
  SeenShare() {
    sensor.camera = {640, 480, 580, 580, 319.5, 239.5, {}};
    sensor.X_WS.position = {0, 0, 1};
    sensor.X_WS.rotation = look_at({0, 0, 1}, {1, 0, 1});
    box.center = {3, 0, 0.8};
    box.size = {0.4, 0.4, 1.6};
  }
  RigSensor sensor;
  Box box;
  // The front face, by hand: 0.2 m to either side, from 1.0 m below to 0.6 m above the axis, at 2.8
  // m.
  static constexpr double kScale = 580 / 2.8;
  const std::array<int, 4> front{
      static_cast<int>(319.5 - 0.2 * kScale), static_cast<int>(239.5 - 0.6 * kScale),
      static_cast<int>(319.5 + 0.2 * kScale), static_cast<int>(239.5 + 1.0 * kScale)};
};

TEST_F(SeenShare, IsOneForThePersonInFullView) {
  EXPECT_NEAR(seen_share(box, sensor, front), 1.0, 0.03);
}

TEST_F(SeenShare, IsTheShareAboveASeatBack) {
  auto upper = front;
  upper[3] = 240;  // all below the axis is hidden: 0.6 m of 1.6 m are left
  EXPECT_NEAR(seen_share(box, sensor, upper), 0.6 / 1.6, 0.03);
}

TEST_F(SeenShare, PixelsOutsideOfTheBoxDoNotCount) {
  EXPECT_NEAR(seen_share(box, sensor, {0, 0, 639, 479}), 1.0, 1e-6);
  EXPECT_EQ(seen_share(box, sensor, {0, 0, 20, 479}), 0.0F);
}

TEST_F(SeenShare, WhatLiesBeyondTheImageWasNotSeen) {
  box.center[1] = 3 * 319.5 / 580;  // its middle on the left border of the image
  const double v_min = front[1], v_max = front[3];
  const float share =
      seen_share(box, sensor, {0, static_cast<int>(v_min), 80, static_cast<int>(v_max)});
  EXPECT_GT(share, 0.35F);
  EXPECT_LT(share, 0.65F);
}

TEST_F(SeenShare, IsZeroBehindTheSensor) {
  box.center[0] = -3;
  EXPECT_EQ(seen_share(box, sensor, {0, 0, 639, 479}), 0.0F);
}

TEST_F(SeenShare, TurnsWithTheBox) {
  box.size = {0.4, 1.2, 1.6};
  box.yaw = 1.5707963267948966;  // its long side along the line of sight
  EXPECT_GT(seen_share(box, sensor, front), 0.9F);
  box.yaw = 0;
  EXPECT_NEAR(seen_share(box, sensor, front), 1.0 / 3, 0.03);
}

}  // namespace
}  // namespace wagonsight
