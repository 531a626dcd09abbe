#include "geometry/camera.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "arbitrary.h"
#include "support/kinect_camera.h"

namespace wagonsight {
namespace {

// As strong as real lenses have it: published calibrations of Kinects reach k1 = 0.23, k2 = -0.38.
Camera any_camera() {
  Camera camera = testing::kinect_camera();
  camera.distortion = {test::real_in(-0.25, 0.25), test::real_in(-0.1, 0.4),
                       test::real_in(-0.01, 0.01), test::real_in(-0.01, 0.01),
                       test::real_in(-0.05, 0.05)};
  return camera;
}

Eigen::Vector2d any_pixel() {
  return {test::real_in(0, 639), test::real_in(0, 479)};
}

// Worked out by hand from the formula in OpenCV's documentation at x = 0.4, y = -0.3 (r2 = 0.25).
TEST(Camera, DistortsByBrownsFormula) {
  Camera camera = testing::kinect_camera();
  camera.distortion = {0.2301, -0.3803, 0.0084, -0.0101, 0.0061};
  const double radial = 1 + 0.2301 * 0.25 - 0.3803 * 0.0625 + 0.0061 * 0.015625;
  const Eigen::Vector2d d = distort(camera, {0.4, -0.3});
  EXPECT_NEAR(d.x(), 0.4 * radial + 2 * 0.0084 * 0.4 * -0.3 - 0.0101 * (0.25 + 2 * 0.16), 1e-12);
  EXPECT_NEAR(d.y(), -0.3 * radial + 0.0084 * (0.25 + 2 * 0.09) + 2 * -0.0101 * 0.4 * -0.3, 1e-12);
}

TEST(Camera, HasItsPrincipalPointStraightAhead) {
  const auto pixel = project(testing::kinect_camera(), {0, 0, 2});
  ASSERT_TRUE(pixel);
  EXPECT_EQ(*pixel, Eigen::Vector2d(306.72, 267.07));
}

TEST(Camera, SeesNothingBehindIt) {
  EXPECT_FALSE(project(testing::kinect_camera(), {0, 0, 0}));
  EXPECT_FALSE(project(testing::kinect_camera(), {0, 0, -1}));
  EXPECT_FALSE(project(testing::kinect_camera(), {0, 0, std::nan("")}));
}

TEST(Camera, WithoutDistortionIsAPinhole) {
  const auto ray = ray_through(testing::kinect_camera(), {10, 20});
  ASSERT_TRUE(ray);
  EXPECT_DOUBLE_EQ(ray->x(), (10 - 306.72) / 525.87);
  EXPECT_DOUBLE_EQ(ray->y(), (20 - 267.07) / 527.81);
  EXPECT_EQ(ray->z(), 1.0);
}

RC_GTEST_PROP(Camera, UndistortInvertsDistort, ()) {
  const Camera camera = any_camera();
  const Eigen::Vector2d seen = any_pixel();
  const Eigen::Vector2d distorted((seen.x() - camera.cx) / camera.fx,
                                  (seen.y() - camera.cy) / camera.fy);
  const auto ideal = undistort(camera, distorted);
  // A strong barrel folds the corners over: there is no inverse and it says so.
  if (!ideal) {
    RC_ASSERT(distorted.norm() > 0.5);
    return;
  }
  RC_ASSERT((distort(camera, *ideal) - distorted).norm() < 1e-9);
}

RC_GTEST_PROP(Camera, RayThroughAPixelProjectsToIt, ()) {
  const Camera camera = any_camera();
  const Eigen::Vector2d pixel = any_pixel();
  const auto ray = ray_through(camera, pixel);
  RC_PRE(ray.has_value());
  const auto back = project(camera, *ray * test::real_in(0.3, 8));
  RC_ASSERT(back.has_value());
  RC_ASSERT((*back - pixel).norm() < 1e-6);
}

TEST(Camera, SaysWhereItsDistortionHasNoInverse) {
  Camera camera = testing::kinect_camera();
  camera.distortion = {-0.9, 0, 0, 0, 0};  // r (1 - 0.9 r^2) never exceeds 0.406
  EXPECT_TRUE(undistort(camera, {0.3, 0}));
  EXPECT_FALSE(undistort(camera, {0.45, 0}));
  EXPECT_FALSE(ray_through(camera, {0, 0}));
}

}  // namespace
}  // namespace wagonsight
