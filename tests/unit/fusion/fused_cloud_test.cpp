#include "fusion/fused_cloud.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <set>
#include <tuple>
#include <vector>

#include "geometry/angles.h"

namespace wagonsight {
namespace {

Rig two_sensors() {
  Rig rig;
  for (const double x : {0.0, 6.0}) {
    RigSensor sensor;
    sensor.camera = {640, 480, 580, 580, 319.5, 239.5, {}};
    sensor.X_WS = {look_at({x, 0, 2.3}, {3, 0, 1.0}), {x, 0, 2.3}};
    rig.sensors.push_back(sensor);
  }
  return rig;
}

Foreground with_points(std::initializer_list<ForegroundPoint> points) {
  Foreground foreground(640 * 480);
  for (const ForegroundPoint& point : points) EXPECT_TRUE(foreground.points.try_push_back(point));
  return foreground;
}

TEST(Fusion, MakesOnePointOfWhatTwoSensorsSeeInOnePlace) {
  Fusion fusion(two_sensors(), 0.02);
  const Foreground first = with_points({{3.001F, 0.011F, 1.011F, 0.02F, 5, 3}});
  const Foreground second = with_points({{3.009F, 0.011F, 1.011F, 0.02F, 7, 4}});
  const std::array<ForegroundView, 2> views{{{&first, {}}, {&second, {}}}};
  const FusedCloud& cloud = fusion.fuse(views, {});
  ASSERT_EQ(cloud.points.size(), 1U);
  EXPECT_EQ(cloud.points[0].sensors, 3);
  EXPECT_NEAR(cloud.points[0].x, 3.005, 1e-4);  // equally sure: the middle
  EXPECT_EQ(cloud.points[0].blob, 3);
  // Seen from both sides, so there is no side on which its centre must lie.
  EXPECT_NEAR(cloud.points[0].away_x, 0, 0.02);
  ASSERT_EQ(cloud.contributions.size(), 2U);
  EXPECT_EQ(cloud.contributions[1].pixels, 7);
  EXPECT_NEAR(cloud.contributions[1].u, 319.5, 2);
}

TEST(Fusion, MovesWhatMovesToTheCommonInstant) {
  Fusion fusion(two_sensors(), 0.02);
  const Foreground late = with_points({{3.5F, 0, 1, 0.02F, 5, 0}, {5.0F, 0, 1, 0.02F, 5, 0}});
  const std::array<ForegroundView, 1> views{{{&late, std::chrono::milliseconds(16)}}};
  const std::array<MotionHint, 1> hints{{{3.4F, 0, 0.5F, 1.5F, -0.5F}}};
  const FusedCloud& cloud = fusion.fuse(views, hints);
  ASSERT_EQ(cloud.points.size(), 2U);
  EXPECT_NEAR(cloud.points[0].x, 3.5 - 0.016 * 1.5, 1e-5);
  EXPECT_NEAR(cloud.points[0].y, 0.016 * 0.5, 1e-5);
  EXPECT_FLOAT_EQ(cloud.points[1].x, 5.0F);  // belongs to no track
}

TEST(Fusion, SkipsSensorsWithoutAFrame) {
  Fusion fusion(two_sensors(), 0.02);
  const Foreground here = with_points({{3, 0, 1, 0.02F, 5, 0}});
  const std::array<ForegroundView, 2> views{{{nullptr, {}}, {&here, {}}}};
  const FusedCloud& cloud = fusion.fuse(views, {});
  ASSERT_EQ(cloud.points.size(), 1U);
  EXPECT_EQ(cloud.points[0].sensors, 2);
}

TEST(Fusion, LosesAndInventsNothing) {
  EXPECT_TRUE(rc::check([] {
    static Fusion fusion(two_sensors(), 0.05);
    static Foreground foreground(640 * 480);
    foreground.points.clear();
    const auto places = *rc::gen::container<std::vector<int>>(rc::gen::inRange(0, 1000));
    std::set<std::tuple<int, int, int>> voxels;
    for (const int place : places) {
      // In the middle of voxels, so that no rounding decides.
      const int x = 20 + place % 10;
      const int y = place / 10 % 10;
      const int z = 10 + place / 100;
      voxels.insert({x, y, z});
      const auto middle = [](int voxel) { return 0.05F * (static_cast<float>(voxel) + 0.5F); };
      RC_ASSERT(foreground.points.try_push_back({middle(x), middle(y), middle(z), 0.01F, 2, 0}));
    }
    const std::array<ForegroundView, 1> views{{{&foreground, {}}}};
    const FusedCloud& cloud = fusion.fuse(views, {});
    RC_ASSERT(cloud.points.size() == voxels.size());
    RC_ASSERT(cloud.contributions.size() == places.size());
    RC_ASSERT(cloud.dropped == 0U);
    for (std::size_t i = 0; i < places.size(); ++i)
      RC_ASSERT(std::abs(cloud.points[cloud.contributions[i].point].x - foreground.points[i].x) <
                1e-4F);
  }));
}

}  // namespace
}  // namespace wagonsight
