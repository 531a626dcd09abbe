#include "people/upright_shapes.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "support/body_cloud.h"

namespace wagonsight {
namespace {

using testing::add_column;
using testing::add_person;
using testing::SeenFrom;

constexpr SeenFrom kFromTheDoor{false, 0.0, 2.0};

// A board that faces the sensor.
void add_board(FusedCloud& cloud, double x, double y_from, double y_to, double low, double high) {
  for (double y = y_from; y < y_to; y += 0.02)
    for (double z = low; z < high; z += 0.02) testing::add_point(cloud, x, y, z, kFromTheDoor);
}

std::size_t points_kept(const FusedCloud& cloud) {
  UprightShapes shapes(testing::room());
  return shapes.select(cloud).points.size();
}

TEST(UprightShapes, KeepsAPersonAnywhereAtAnyHeight) {
  EXPECT_TRUE(rc::check([] {
    const double x = 1.2 + 0.01 * *rc::gen::inRange(0, 400);
    const double y = 1 + 0.01 * *rc::gen::inRange(0, 200);
    FusedCloud cloud;
    add_person(cloud, x, y, 0.01 * *rc::gen::inRange(150, 201), kFromTheDoor);
    RC_ASSERT(points_kept(cloud) > cloud.points.size() * 9 / 10);
  }));
}

TEST(UprightShapes, KeepsPeopleAndDropsTheRoomAroundThem) {
  FusedCloud cloud;
  add_person(cloud, 2.0, 1.4, 1.75, kFromTheDoor);
  add_person(cloud, 2.6, 2.4, 1.65, kFromTheDoor);
  const std::size_t people = cloud.points.size();
  add_board(cloud, 5.0, 0.2, 3.8, 0.1, 2.3);                        // a wall
  add_board(cloud, 3.8, 0.2, 1.2, 0.1, 1.2);                        // a cupboard
  add_column(cloud, 1.5, 3.4, 0.1, 2.0, 0.03, 0.03, kFromTheDoor);  // a pole
  add_board(cloud, 3.0, 3.2, 3.8, 0.4, 1.0);                        // the back of a seat
  UprightShapes shapes(testing::room());
  const FusedCloud& kept = shapes.select(cloud);
  EXPECT_GT(kept.points.size(), people * 9 / 10);
  EXPECT_LE(kept.points.size(), people);
  for (const Contribution& contribution : kept.contributions)
    ASSERT_LT(contribution.point, kept.points.size());
  EXPECT_EQ(kept.contributions.size(), kept.points.size());
}

TEST(UprightShapes, DropsFurnitureAlone) {
  FusedCloud cloud;
  add_board(cloud, 4.0, 0.2, 3.8, 0.1, 2.3);
  EXPECT_EQ(points_kept(cloud), 0U);
  add_column(cloud, 2.0, 2.0, 0.1, 1.9, 0.25, 0.25, kFromTheDoor);  // a bin: no head
  EXPECT_EQ(points_kept(cloud), 0U);
  add_board(cloud, 1.5, 0.5, 1.7, 0.7, 1.1);  // a monitor
  EXPECT_EQ(points_kept(cloud), 0U);
  EXPECT_EQ(points_kept(FusedCloud{}), 0U);
}

// Surface that noise has made as deep as a room has no shape.
TEST(UprightShapes, TellsNothingFromNoise) {
  FusedCloud cloud;
  add_person(cloud, 3.0, 2.0, 1.75, kFromTheDoor);
  for (FusedPoint& point : cloud.points) point.sigma = 0.12F;
  EXPECT_EQ(points_kept(cloud), 0U);
}

}  // namespace
}  // namespace wagonsight
