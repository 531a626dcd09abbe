#include "pipeline/place_on_floor.h"

#include <gtest/gtest.h>

#include "support/drawn_room.h"

namespace wagonsight {
namespace {

TEST(PlaceOnFloor, FindsHeightAndTiltOfASensorWithoutAPose) {
  RigSensor sensor = testing::drawn_sensor("k0", {0.2, 2, 1.9}, {4, 2, 1.0});
  std::vector<std::uint16_t> pixels;
  testing::draw(sensor, testing::drawn_person(3, 2, 1.7), pixels);
  const auto rays = make_ray_table(sensor.camera);
  const Eigen::Vector3d up_S = sensor.X_WS.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  sensor.X_WS = {};
  sensor.has_pose = false;
  Wagon wagon;
  const std::array<DepthImage, 1> images{{{pixels.data(), 320, 240}}};
  ASSERT_TRUE(place_on_floor(images, rays, sensor, wagon).has_value());
  EXPECT_TRUE(sensor.has_pose);
  EXPECT_NEAR(sensor.X_WS.position.z(), 1.9, 0.02);
  EXPECT_GT((sensor.X_WS.rotation.conjugate() * Eigen::Vector3d::UnitZ()).dot(up_S), 0.9995);
  EXPECT_GT(wagon.inside.max.x(), 5);
  EXPECT_EQ(wagon.inside.min.z(), 0);
}

TEST(PlaceOnFloor, SaysThatThereIsNoFloor) {
  RigSensor sensor = testing::drawn_sensor("k0", {0, 0, 2}, {3, 0, 1});
  const std::vector<std::uint16_t> pixels(320 * 240, 0);
  const auto rays = make_ray_table(sensor.camera);
  Wagon wagon;
  const std::array<DepthImage, 1> images{{{pixels.data(), 320, 240}}};
  const auto placed = place_on_floor(images, rays, sensor, wagon);
  ASSERT_FALSE(placed.has_value());
  EXPECT_NE(placed.error().message.find("k0"), std::string::npos);
  const std::array<DepthImage, 1> small{{{pixels.data(), 160, 120}}};
  EXPECT_FALSE(place_on_floor(small, rays, sensor, wagon).has_value());
}

// A camera that looks level at a wall and a ceiling: up is told by the ceiling.
TEST(PlaceLevel, StandsUprightWhereOnlyTheCeilingIsSeen) {
  RigSensor sensor = testing::drawn_sensor("k0", {0, 2, 1.2}, {4, 2, 2.0});
  const Rigid truth = sensor.X_WS;
  const auto rays = make_ray_table(sensor.camera);
  std::vector<std::uint16_t> pixels(rays.size(), 0);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Eigen::Vector3d ray = truth.rotation * Eigen::Vector3d(rays[i].x * double{kRayScale},
                                                                 rays[i].y * double{kRayScale}, 1);
    double z = 5.0 / ray.x();                                 // a wall
    if (ray.z() > 0) z = std::min(z, (2.5 - 1.2) / ray.z());  // the ceiling
    if (ray.z() < 0 && 1.2 + z * ray.z() < 0.05) z = 0;       // the floor is too dark
    pixels[i] = static_cast<std::uint16_t>(1000 * z);
  }
  sensor.X_WS = {};
  sensor.has_pose = false;
  Wagon wagon;
  const std::array<DepthImage, 1> images{{{pixels.data(), 320, 240}}};
  EXPECT_FALSE(place_on_floor(images, rays, sensor, wagon).has_value());
  ASSERT_TRUE(place_level(images, rays, sensor, wagon).has_value());
  EXPECT_TRUE(sensor.has_pose);
  EXPECT_NEAR(sensor.X_WS.position.z(), 1.2, 0.1);
  const Eigen::Vector3d up = truth.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  EXPECT_GT((sensor.X_WS.rotation.conjugate() * Eigen::Vector3d::UnitZ()).dot(up), 0.999);
  EXPECT_GT(wagon.inside.max.x(), 5);

  std::fill(pixels.begin(), pixels.end(), std::uint16_t{0});
  const auto refused = place_level(images, rays, sensor, wagon);
  ASSERT_FALSE(refused.has_value());
  EXPECT_NE(refused.error().message.find("trim_m"), std::string::npos);
}

}  // namespace
}  // namespace wagonsight
