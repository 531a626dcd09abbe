#include "rig/ray_table.h"

#include <gtest/gtest.h>

#include <cmath>

#include "support/kinect_camera.h"

namespace wagonsight {
namespace {

TEST(RayTable, ProjectsBackToItsPixelWithinTheStepOfTheFixedPoint) {
  const Camera camera = testing::kinect_camera({-0.09, 0.28, 0.0008, -0.0012, -0.23});
  const auto rays = make_ray_table(camera);
  ASSERT_EQ(rays.size(), 640U * 480U);
  // Half a step of 1/16384 at f = 580 is 0.018 pixels on each axis, a little more with distortion.
  double worst_px = 0;
  for (int v = 0; v < 480; v += 7) {
    for (int u = 0; u < 640; u += 7) {
      const PixelRay ray = rays[static_cast<std::size_t>(v * 640 + u)];
      ASSERT_NE(ray.x, kNoRay);
      const auto pixel = project(camera, {ray.x * static_cast<double>(kRayScale),
                                          ray.y * static_cast<double>(kRayScale), 1.0});
      ASSERT_TRUE(pixel);
      worst_px = std::max(worst_px, (*pixel - Eigen::Vector2d(u, v)).norm());
    }
  }
  EXPECT_LT(worst_px, 0.04);
}

TEST(RayTable, MarksPixelsWhoseDistortionHasNoInverse) {
  Camera camera = testing::kinect_camera({-0.09, 0.28, 0.0008, -0.0012, -0.23});
  camera.distortion = {-0.9, 0, 0, 0, 0};  // folds the image over near its corners
  const auto rays = make_ray_table(camera);
  EXPECT_EQ(rays.front().x, kNoRay);
  EXPECT_NE(rays[240 * 640 + 320].x, kNoRay);
}

TEST(RayTable, MarksRaysBeyondItsRange) {
  Camera camera = testing::kinect_camera({-0.09, 0.28, 0.0008, -0.0012, -0.23});
  camera.distortion = {};
  camera.fx = camera.fy = 150;  // the left edge looks at x = -2.12
  const auto rays = make_ray_table(camera);
  EXPECT_EQ(rays[240 * 640].x, kNoRay);
  EXPECT_NE(rays[240 * 640 + 40].x, kNoRay);
}

TEST(RayTable, OfABrokenCameraHasNoRays) {
  Camera camera = testing::kinect_camera({-0.09, 0.28, 0.0008, -0.0012, -0.23});
  camera.fx = std::nan("");
  for (const PixelRay ray : make_ray_table(camera)) ASSERT_EQ(ray.x, kNoRay);
}

}  // namespace
}  // namespace wagonsight
