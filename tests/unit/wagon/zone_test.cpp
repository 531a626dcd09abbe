#include <gtest/gtest.h>

#include "wagon/wagon.h"

namespace wagonsight {
namespace {

Zone l_shape() {
  Zone zone;
  for (const auto& corner :
       {std::array{0.0, 0.0}, {4.0, 0.0}, {4.0, 1.0}, {1.0, 1.0}, {1.0, 3.0}, {0.0, 3.0}}) {
    zone.polygon.push_back(corner);
  }
  return zone;
}

TEST(Zone, ContainsWhatIsInsideItsPolygon) {
  const Zone zone = l_shape();
  EXPECT_TRUE(contains(zone, {0.5, 0.5}));
  EXPECT_TRUE(contains(zone, {3.5, 0.5}));
  EXPECT_TRUE(contains(zone, {0.5, 2.9}));
  EXPECT_FALSE(contains(zone, {2.0, 2.0}));  // in the notch
  EXPECT_FALSE(contains(zone, {-0.1, 0.5}));
  EXPECT_FALSE(contains(zone, {4.1, 0.5}));
  EXPECT_FALSE(contains(zone, {0.5, 3.1}));
}

TEST(Zone, WithoutCornersContainsNothing) {
  EXPECT_FALSE(contains(Zone{}, {0, 0}));
}

TEST(DepthInside, CountsToTheNearestWallAndInADoorwayToItsThreshold) {
  Wagon wagon;
  wagon.inside = {{0.04, 0.04, 0}, {5.96, 2.66, 2.4}};
  wagon.doors.push_back({Name("south"), {2.0, 0.0}, {4.0, 0.0}});
  wagon.doors.push_back({Name("north"), {4.0, 2.7}, {2.0, 2.7}});
  EXPECT_NEAR(depth_inside(wagon, {1.0, 0.54}).m, 0.5, 1e-9);
  EXPECT_EQ(depth_inside(wagon, {1.0, 0.54}).door, -1);
  EXPECT_NEAR(depth_inside(wagon, {3.0, 0.02}).m, 0.02, 1e-9);
  EXPECT_EQ(depth_inside(wagon, {3.0, 0.02}).door, 0);
  EXPECT_NEAR(depth_inside(wagon, {3.0, -0.3}).m, -0.3, 1e-9);
  EXPECT_NEAR(depth_inside(wagon, {3.0, 2.8}).m, -0.1, 1e-9);
  EXPECT_EQ(depth_inside(wagon, {3.0, 2.8}).door, 1);
  EXPECT_EQ(depth_inside(wagon, {3.0, 1.3}).door, -1);  // the middle is no doorway
}

TEST(Bounds, IncludeTheirFaces) {
  const Bounds box{{0, 0, 0}, {1, 2, 3}};
  EXPECT_TRUE(box.contains({0, 2, 3}));
  EXPECT_FALSE(box.contains({0, 2, 3.01}));
}

}  // namespace
}  // namespace wagonsight
