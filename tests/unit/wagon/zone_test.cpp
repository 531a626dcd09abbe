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

TEST(Bounds, IncludeTheirFaces) {
  const Bounds box{{0, 0, 0}, {1, 2, 3}};
  EXPECT_TRUE(box.contains({0, 2, 3}));
  EXPECT_FALSE(box.contains({0, 2, 3.01}));
}

}  // namespace
}  // namespace wagonsight
