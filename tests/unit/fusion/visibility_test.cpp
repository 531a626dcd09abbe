#include "fusion/visibility.h"

#include <gtest/gtest.h>

#include <vector>

#include "base/capacities.h"
#include "geometry/angles.h"

namespace wagonsight {
namespace {

// One camera at x = 0, 1.2 m high, looks level along +x at a wall 5 m away.
class Corridor : public ::testing::Test {
 protected:
  Corridor() : pixels_(640 * 480, 5000) {
    RigSensor sensor;
    sensor.camera = {640, 480, 580, 580, 319.5, 239.5, {}};
    sensor.X_WS = {look_at({0, 0, 1.2}, {5, 0, 1.2}), {0, 0, 1.2}};
    rig_.sensors.push_back(sensor);
    slot_.width = 640;
    slot_.height = 480;
    slot_.bytes = std::as_writable_bytes(std::span(pixels_));
    set_.sensors[0] = {FrameState::kPresent, &slot_, {}};
  }
  void put_screen(std::uint16_t depth_mm) {
    for (int v = 0; v < 480; ++v)
      for (int u = 200; u < 440; ++u) pixels_[static_cast<std::size_t>(v * 640 + u)] = depth_mm;
  }
  void tick(VisibilityGrid& grid, double seconds) {
    set_.instant = HostTime{from_seconds(seconds)};
    grid.update(set_);
  }

  Rig rig_;
  Bounds inside_{{0.5, -2, 0}, {5.5, 2, 2.4}};
  std::vector<std::uint16_t> pixels_;
  FrameSlot slot_;
  FrameSet set_;
};

TEST_F(Corridor, TellsFreeOccupiedAndUnobservedApart) {
  put_screen(2500);
  VisibilityGrid grid(rig_, inside_);
  tick(grid, 0);
  EXPECT_EQ(grid.at(2.0, 0, 1.2), Visibility::kFree);
  EXPECT_EQ(grid.at(2.5, 0, 1.2), Visibility::kOccupied);
  EXPECT_EQ(grid.at(3.5, 0, 1.2), Visibility::kUnobserved);    // behind the screen
  EXPECT_EQ(grid.at(1.0, 1.9, 1.2), Visibility::kUnobserved);  // beside the view
  EXPECT_EQ(grid.at(-1, 0, 1), Visibility::kUnobserved);       // outside of the grid
}

TEST_F(Corridor, ForgetsWhatALostSensorSaw) {
  VisibilityGrid grid(rig_, inside_);
  tick(grid, 0);
  const Bounds seat{{2, -0.3, 0.9}, {2.6, 0.3, 1.5}};
  EXPECT_GT(grid.observed_share(seat), 0.9);
  set_.sensors[0] = {FrameState::kLost, nullptr, {}};
  tick(grid, 1.0);
  EXPECT_GT(grid.observed_share(seat), 0.9);  // remembered for a moment
  tick(grid, 2.0);
  EXPECT_EQ(grid.observed_share(seat), 0.0);
}

TEST_F(Corridor, LooksThroughAnEmptyPlaceAndNotBehindAScreen) {
  VisibilityGrid grid(rig_, inside_);
  tick(grid, 0);
  EXPECT_GT(grid.look_at_column(3, 0, 1.7).free, 0.9F);
  put_screen(2000);
  tick(grid, 0.1);
  EXPECT_GT(grid.look_at_column(3, 0, 1.7).occluded, 0.9F);
  put_screen(3000);
  tick(grid, 0.2);
  EXPECT_GT(grid.look_at_column(3, 0, 1.7).surface, 0.9F);
  EXPECT_GT(grid.look_at_column(0.8, 1.8, 1.7).outside, 0.9F);
  set_.sensors[0] = {FrameState::kLate, nullptr, {}};
  tick(grid, 0.3);
  // A sensor that would see it is missing: that says nothing about the place.
  EXPECT_GT(grid.look_at_column(3, 0, 1.7).no_reading, 0.9F);
}

TEST(VisibilityGrid, GrowsItsCellsUntilTheyFit) {
  VisibilityGrid grid(Rig{}, {{0, 0, 0}, {40, 30, 3}}, 0.05);
  EXPECT_EQ(grid.at(39, 29, 2.5), Visibility::kUnobserved);
}

}  // namespace
}  // namespace wagonsight
