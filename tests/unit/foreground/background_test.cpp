#include "foreground/background.h"

#include <gtest/gtest.h>

#include "support/rendered_room.h"

namespace wagonsight {
namespace {

using testing_support::RenderedRoom;

struct Scene {
  RenderedRoom room;
  LeafGrid grid = *LeafGrid::cover(room.wagon.inside.min.array() - 0.3,
                                   room.wagon.inside.max.array() + 0.3, 0.02);
  SensorView view{room.sensor, room.rays, room.wagon, grid, 3.0};
  Background background{view};
};

// Every remembered interval must equal the octree after a whole life of a background.
void expect_memory_equals_octree(const Scene& s) {
  const auto& thresholds = s.background.thresholds();
  std::size_t wrong = 0;
  for (std::size_t pixel = 0; pixel < s.view.pixel_count(); ++pixel) {
    for (std::uint16_t raw = 500; raw < 6000; raw += 61) {
      if (thresholds.classify(s.view, s.background.leaves(), pixel, raw) !=
          thresholds.classify_by_octree(s.view, s.background.leaves(), pixel, raw)) {
        ++wrong;
      }
    }
  }
  // A ray may graze a leaf's edge in one and miss it in the other by a rounding.
  EXPECT_LE(wrong, s.view.pixel_count() / 5000);
}

TEST(Background, IsWhatWasThereMostOfTheTime) {
  Scene s;
  for (int frame = 0; frame < 30; ++frame) {
    // Somebody passes through the first third.
    const auto image =
        frame < 10 ? s.room.render({RenderedRoom::somebody_at(2.0 + 0.1 * frame, 1.7)}, frame)
                   : s.room.render({}, frame);
    s.background.gather(s.view, s.room.view(image));
  }
  s.background.decide(s.view);
  const auto empty = s.room.render({}, -1);
  std::size_t unexplained = 0;
  for (std::size_t pixel = 0; pixel < empty.size(); ++pixel) {
    if (s.background.thresholds().classify(s.view, s.background.leaves(), pixel, empty[pixel]) ==
        Reading::kForeground) {
      ++unexplained;
    }
  }
  EXPECT_LT(unexplained, empty.size() / 1000);
  // Nothing is left where somebody walked.
  s.background.leaves().visit([&](LeafAddress leaf) {
    const Eigen::Vector3d p = s.grid.centre(s.grid.leaf_at(leaf));
    EXPECT_FALSE(p.x() > 1.9 && p.x() < 2.9 && p.y() > 1.5 && p.y() < 1.9 && p.z() > 0.3) << p;
  });
  expect_memory_equals_octree(s);
}

TEST(Background, IsSeenThroughWhenItLeaves) {
  Scene s;
  const testing_support::RoomBox parcel{{3.0, 1.4, 0.0}, {3.5, 1.9, 0.9}};
  const auto with = s.room.render({parcel}, 1);
  s.background.assume(s.view, s.room.view(with));
  const auto count_in_parcel = [&] {
    std::size_t count = 0;
    s.background.leaves().visit([&](LeafAddress leaf) {
      const Eigen::Vector3d p = s.grid.centre(s.grid.leaf_at(leaf));
      if ((p.array() > parcel.min.array() - 0.1).all() &&
          (p.array() < parcel.max.array() + 0.1).all() && p.z() > 0.2) {
        ++count;
      }
    });
    return count;
  };
  const std::size_t before = count_in_parcel();
  ASSERT_GT(before, 200U);
  for (int frame = 0; frame < 30; ++frame) {
    const auto image = s.room.render({}, frame);
    const float share = s.background.advance(HostTime{} + from_seconds(frame * 0.1));
    s.background.observe_free(s.view, s.room.view(image), share);
  }
  EXPECT_LT(count_in_parcel(), before / 50);
  expect_memory_equals_octree(s);
}

}  // namespace
}  // namespace wagonsight
