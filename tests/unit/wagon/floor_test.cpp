#include "wagon/floor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "geometry/angles.h"
#include "support/depth_png.h"
#include "support/pcd_points.h"

namespace wagonsight {
namespace {

constexpr double kDegree = M_PI / 180;

// Points of a room (floor at z = 0, four walls, a ceiling, a large desk) as a sensor sees them with
// a Kinect's noise. Walls and desk cover more pixels than the floor in the flat views.
std::vector<Eigen::Vector3f> room_seen_from(const Rigid& X_WS, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise;
  std::vector<Eigen::Vector3f> points;
  const Eigen::Vector3d origin = X_WS.position;
  for (int v = 0; v < 240; v += 2) {
    for (int u = 0; u < 320; u += 2) {
      const Eigen::Vector3d ray_S((u - 160) / 290.0, (v - 120) / 290.0, 1.0);
      const Eigen::Vector3d ray = X_WS.rotation * ray_S;
      double z = 20;
      const auto hit = [&](double at) {
        if (at > 0) z = std::min(z, at);
      };
      hit(-origin.z() / ray.z());
      hit((2.6 - origin.z()) / ray.z());
      for (const double wall : {-1.0, 6.0}) hit((wall - origin.x()) / ray.x());
      for (const double wall : {-2.5, 2.5}) hit((wall - origin.y()) / ray.y());
      const double desk = (0.75 - origin.z()) / ray.z();
      const Eigen::Vector3d on = origin + desk * ray;
      if (desk > 0 && on.x() > 1.0 && on.x() < 3.0 && on.y() > 0.2 && on.y() < 2.0) hit(desk);
      if (z > 8) continue;
      points.push_back((ray_S * (z + 0.0019 * z * z * noise(random))).cast<float>());
    }
  }
  return points;
}

class FloorUnderATiltedSensor : public testing::TestWithParam<double> {};

TEST_P(FloorUnderATiltedSensor, IsFoundToACentimetreAndHalfADegree) {
  const double tilt = GetParam() * kDegree;
  const Eigen::Vector3d position(0, 0, 2.3);
  Rigid X_WS{look_at(position, position + Eigen::Vector3d(std::cos(tilt), 0, -std::sin(tilt))),
             position};
  // The sensor hangs three degrees askew.
  X_WS.rotation =
      X_WS.rotation * Eigen::Quaterniond(Eigen::AngleAxisd(3 * kDegree, Eigen::Vector3d::UnitZ()));
  const auto floor = find_floor(room_seen_from(X_WS, 5), 1.1);
  ASSERT_TRUE(floor.has_value());
  // At four degrees only its farthest metre is seen.
  const bool little_seen = GetParam() < 8;
  EXPECT_NEAR(floor->X_WS.position.z(), 2.3, little_seen ? 0.08 : 0.01);
  EXPECT_NEAR(floor->X_WS.position.head<2>().norm(), 0, 1e-12);
  const Eigen::Vector3d up_S = floor->X_WS.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d up_true_S = X_WS.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  EXPECT_LT(std::acos(std::min(1.0, up_S.dot(up_true_S))), (little_seen ? 1.0 : 0.5) * kDegree);
  // It looks along +x of W.
  const Eigen::Vector3d forward = floor->X_WS.rotation * Eigen::Vector3d::UnitZ();
  EXPECT_NEAR(forward.y(), 0, 1e-9);
  EXPECT_GT(forward.x(), 0);
}

INSTANTIATE_TEST_SUITE_P(Tilts, FloorUnderATiltedSensor,
                         testing::Values(4.0, 8.0, 15.0, 30.0, 45.0, 60.0));

TEST(Floor, IsTheSameEveryTime) {
  const Rigid X_WS{look_at({0, 0, 2}, {3, 0, 0.5}), {0, 0, 2}};
  const auto points = room_seen_from(X_WS, 1);
  const auto first = find_floor(points), second = find_floor(points);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->X_WS.position, second->X_WS.position);
  EXPECT_EQ(first->X_WS.rotation.coeffs(), second->X_WS.rotation.coeffs());
}

TEST(Floor, IsNotAWall) {
  std::vector<Eigen::Vector3f> wall;
  for (int i = 0; i < 200; ++i) {
    for (int j = 0; j < 100; ++j) {
      wall.push_back(Eigen::Vector3d(0.01 * i - 1, 0.01 * j - 0.5, 2).cast<float>());
    }
  }
  EXPECT_FALSE(find_floor(wall).has_value());
  EXPECT_FALSE(find_floor({}).has_value());
}

TEST(Floor, OfFivePeopleIsThePublishedPlane) {
  const std::string path = WAGONSIGHT_SOURCE_DIR "/../shared/data/five_people/five_people.pcd";
  std::vector<Eigen::Vector3f> points = testing_support::read_pcd(path);
  if (points.empty()) GTEST_SKIP() << "the recording five_people is not on this machine";
  std::erase_if(points, [](const Eigen::Vector3f& p) { return !p.allFinite(); });
  const auto floor = find_floor(points);
  ASSERT_TRUE(floor.has_value());
  // The published plane's normal points down (the image's y).
  const Eigen::Vector3d down_S = floor->X_WS.rotation.conjugate() * -Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d published = Eigen::Vector3d(-0.0103586, 0.997011, 0.0765573).normalized();
  EXPECT_LT(std::acos(down_S.dot(published)), 1.5 * kDegree);
  EXPECT_NEAR(floor->X_WS.position.z(), 1.26614, 0.05);
}

TEST(Floor, OfTheSameCameraIsTheSameInTwoRecordings) {
  std::vector<double> heights;
  for (const char* name : {"depth_queue", "depth_walker"}) {
    const auto images = testing_support::read_depth_folder(
        std::string(WAGONSIGHT_SOURCE_DIR "/../shared/data/") + name + "/depth");
    if (images.empty()) GTEST_SKIP() << "the recording " << name << " is not on this machine";
    std::vector<Eigen::Vector3f> points;
    const auto& image = images[images.size() / 2];  // people are in it
    for (std::size_t i = 0; i < image.size(); i += 3) {
      const float z = static_cast<float>(image[i]) * 0.001F;
      if (z < 0.4F || z > 7) continue;
      points.emplace_back((static_cast<float>(i % 640) - 311.1F) / 567.9F * z,
                          (static_cast<float>(i / 640) - 241.6F) / 568.9F * z, z);
    }
    const auto floor = find_floor(points);
    ASSERT_TRUE(floor.has_value()) << name;
    heights.push_back(floor->X_WS.position.z());
  }
  EXPECT_NEAR(heights[0], heights[1], 0.04);
  EXPECT_NEAR(heights[0], 2.37, 0.06);
}

TEST(Inside, CoversTheRoomAndTheSensor) {
  const Rigid X_WS{look_at({0, 0, 2.3}, {3, 0, 0.5}), {0, 0, 2.3}};
  std::vector<Eigen::Vector3f> points_W;
  for (const Eigen::Vector3f& p : room_seen_from(X_WS, 3)) {
    points_W.push_back((X_WS * p.cast<double>()).cast<float>());
  }
  const Bounds inside = find_inside(points_W);
  EXPECT_TRUE(inside.contains({0, 0, 1}));
  EXPECT_TRUE(inside.contains({5.8, 0, 1}));
  EXPECT_LT(inside.max.x(), 6.6);
  EXPECT_EQ(inside.min.z(), 0);
  EXPECT_EQ(inside.max.z(), 2.5);
}

}  // namespace
}  // namespace wagonsight
