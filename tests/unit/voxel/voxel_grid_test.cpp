#include "voxel/voxel_grid.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <array>
#include <cmath>
#include <map>
#include <vector>

namespace wagonsight {
namespace {

struct Sum {
  double x = 0, y = 0, z = 0;
  std::uint32_t points = 0;
};

TEST(VoxelGrid, MeansEqualThePlainTwin) {
  EXPECT_TRUE(rc::check("every voxel's mean and count equal those of a std::map", [] {
    const double voxel_m = *rc::gen::element(0.02, 0.05, 0.1);
    VoxelGrid grid(4096, voxel_m);
    // Frames after each other, so that clear() is tested too.
    const int frames = *rc::gen::inRange(1, 4);
    for (int frame = 0; frame < frames; ++frame) {
      grid.clear();
      std::map<std::array<int, 3>, Sum> twin;
      const int count = *rc::gen::inRange(0, 300);
      for (int i = 0; i < count; ++i) {
        // In the middle of tenths of a voxel, so that no rounding decides about the voxel.
        std::array<int, 3> voxel{};
        std::array<float, 3> p{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const int tenth = *rc::gen::inRange(-400, 400);
          voxel[axis] = static_cast<int>(std::floor(tenth / 10.0));
          p[axis] = static_cast<float>((tenth + 0.5) * 0.1 * voxel_m);
        }
        RC_ASSERT(grid.add(p[0], p[1], p[2]));
        Sum& sum = twin[voxel];
        sum.x += static_cast<double>(p[0]);
        sum.y += static_cast<double>(p[1]);
        sum.z += static_cast<double>(p[2]);
        ++sum.points;
      }
      RC_ASSERT(grid.size() == twin.size());
      for (std::size_t i = 0; i < grid.size(); ++i) {
        const VoxelMean mean = grid.mean(i);
        const auto found = twin.find({static_cast<int>(std::floor(mean.x / voxel_m)),
                                      static_cast<int>(std::floor(mean.y / voxel_m)),
                                      static_cast<int>(std::floor(mean.z / voxel_m))});
        RC_ASSERT(found != twin.end());
        const Sum& sum = found->second;
        RC_ASSERT(mean.points == sum.points);
        RC_ASSERT(std::abs(mean.x - sum.x / sum.points) < 1e-6);
        RC_ASSERT(std::abs(mean.y - sum.y / sum.points) < 1e-6);
        RC_ASSERT(std::abs(mean.z - sum.z / sum.points) < 1e-6);
      }
    }
  }));
}

TEST(VoxelGrid, KeepsTheOrderOfFirstPointsAndRefusesWhenFull) {
  VoxelGrid grid(2, 0.1);
  EXPECT_TRUE(grid.add(0.51F, 0, 0));
  EXPECT_TRUE(grid.add(-0.04F, 0, 0));
  EXPECT_FALSE(grid.add(5, 5, 5));
  EXPECT_TRUE(grid.add(0.53F, 0, 0));
  ASSERT_EQ(grid.size(), 2U);
  EXPECT_NEAR(grid.mean(0).x, 0.52, 1e-6);
  EXPECT_EQ(grid.mean(0).points, 2U);
  EXPECT_NEAR(grid.mean(1).x, -0.04, 1e-6);
  grid.clear();
  EXPECT_EQ(grid.size(), 0U);
  EXPECT_TRUE(grid.add(5, 5, 5));
}

}  // namespace
}  // namespace wagonsight
