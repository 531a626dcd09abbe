#include <gmock/gmock.h>
#include <rapidcheck.h>

#include <algorithm>
#include <iterator>
#include <set>
#include <vector>

#include "voxel/bit_octree.h"

namespace wagonsight {
namespace {

LeafGrid make_grid(double leaf_m = 0.05) {
  auto grid = LeafGrid::cover({-1.0, 0.5, 0.0}, {1.0, 2.2, 3.0}, leaf_m);
  EXPECT_TRUE(grid.has_value());
  return *grid;
}

LeafAddress any_leaf(const LeafGrid& grid) {
  // Half of them from a few bricks, so that leaves meet.
  const auto leaves = static_cast<LeafAddress>(grid.brick_count() * kBrickLeaves);
  return *rc::gen::oneOf(rc::gen::inRange<LeafAddress>(0, leaves),
                         rc::gen::inRange<LeafAddress>(0, 1200));
}

// The plain twin: a set of addresses.
struct Twin {
  std::set<LeafAddress> leaves;
};

std::set<LeafAddress> all_of(const BitOctree& octree) {
  std::set<LeafAddress> result;
  octree.visit([&](LeafAddress leaf) { RC_ASSERT(result.insert(leaf).second); });
  return result;
}

void change_at_random(const LeafGrid& grid, BitOctree& octree, Twin& twin) {
  const int steps = *rc::gen::inRange(0, 200);
  for (int i = 0; i < steps; ++i) {
    const LeafAddress leaf = any_leaf(grid);
    const int what = *rc::gen::inRange(0, 40);
    if (what == 0) {
      octree.clear();
      twin.leaves.clear();
    } else if (what < 12) {
      RC_ASSERT(octree.erase(leaf) == (twin.leaves.erase(leaf) == 1));
    } else {
      RC_ASSERT(octree.insert(leaf) == twin.leaves.insert(leaf).second);
    }
    RC_ASSERT(octree.contains(leaf) == twin.leaves.contains(leaf));
    RC_ASSERT(octree.leaf_count() == twin.leaves.size());
  }
}

TEST(BitOctree, IsASetOfLeaves) {
  EXPECT_TRUE(rc::check("any sequence of changes leaves the octree equal to a std::set", [] {
    const LeafGrid grid = make_grid();
    BitOctree octree(grid);
    Twin twin;
    change_at_random(grid, octree, twin);
    RC_ASSERT(all_of(octree) == twin.leaves);
    for (BrickAddress brick = 0; brick < grid.brick_count(); ++brick) {
      const auto first = twin.leaves.lower_bound(brick * 512);
      RC_ASSERT(octree.brick_occupied(brick) ==
                (first != twin.leaves.end() && *first < (brick + 1) * 512));
    }
  }));
}

TEST(BitOctree, RefusesAndCountsWhenItsBricksAreUsedUp) {
  EXPECT_TRUE(rc::check("never more bricks than it was made for, and none is lost", [] {
    const LeafGrid grid = make_grid();
    constexpr std::size_t kBricks = 5;
    BitOctree octree(grid, kBricks);
    std::set<LeafAddress> twin;
    const auto bricks_of = [&] {
      std::set<BrickAddress> bricks;
      for (const LeafAddress leaf : twin) bricks.insert(leaf / 512);
      return bricks;
    };
    std::uint64_t refused = 0;
    const int steps = *rc::gen::inRange(0, 200);
    for (int i = 0; i < steps; ++i) {
      const LeafAddress leaf =
          *rc::gen::inRange<LeafAddress>(0, 8) * 512 + *rc::gen::inRange<LeafAddress>(0, 3) * 100;
      if (*rc::gen::inRange(0, 3) == 0) {
        RC_ASSERT(octree.erase(leaf) == (twin.erase(leaf) == 1));
      } else if (!bricks_of().contains(leaf / 512) && bricks_of().size() == kBricks) {
        RC_ASSERT(!octree.insert(leaf));
        ++refused;
      } else {
        RC_ASSERT(octree.insert(leaf) == twin.insert(leaf).second);
      }
      RC_ASSERT(octree.contains(leaf) == twin.contains(leaf));
    }
    RC_ASSERT(all_of(octree) == twin);
    RC_ASSERT(octree.refused() == refused);
    RC_ASSERT(octree.high_water() <= kBricks);
  }));
}

TEST(BitOctree, XorIsTheSymmetricDifference) {
  EXPECT_TRUE(rc::check("visit_changed equals the symmetric difference of two sets", [] {
    const LeafGrid grid = make_grid();
    ChangeOctree octree(grid);
    Twin before, now;
    change_at_random(grid, octree.current(), before);
    octree.switch_buffers();
    change_at_random(grid, octree.current(), now);
    std::vector<LeafAddress> changed, expected;
    octree.visit_changed([&](LeafAddress leaf) { changed.push_back(leaf); });
    std::sort(changed.begin(), changed.end());
    std::set_symmetric_difference(before.leaves.begin(), before.leaves.end(), now.leaves.begin(),
                                  now.leaves.end(), std::back_inserter(expected));
    RC_ASSERT(changed == expected);
  }));
}

TEST(BitOctree, SkipsOnlyEmptyNodes) {
  EXPECT_TRUE(rc::check("the largest empty node around a leaf has no leaf, and is the largest", [] {
    const LeafGrid grid = make_grid();
    BitOctree octree(grid);
    Twin twin;
    change_at_random(grid, octree, twin);
    const LeafIndex at = grid.leaf_at(any_leaf(grid));
    const int size = octree.empty_node(grid.address(at));
    const auto has_leaf = [&](int side) {
      return std::any_of(twin.leaves.begin(), twin.leaves.end(), [&](LeafAddress address) {
        const LeafIndex leaf = grid.leaf_at(address);
        return leaf[0] / side == at[0] / side && leaf[1] / side == at[1] / side &&
               leaf[2] / side == at[2] / side;
      });
    };
    if (size > 1) RC_ASSERT(!has_leaf(size));
    const int larger = size == 8 ? 32 : size * 2;
    if (size < 32) RC_ASSERT(has_leaf(larger));
  }));
}

TEST(BitOctree, NewestBufferIsEmptyAfterTheSwitch) {
  const LeafGrid grid = make_grid();
  ChangeOctree octree(grid);
  octree.current().insert(7);
  octree.switch_buffers();
  octree.current().insert(9);
  octree.switch_buffers();
  EXPECT_EQ(octree.current().leaf_count(), 0U);
  EXPECT_TRUE(octree.previous().contains(9));
  EXPECT_FALSE(octree.previous().contains(7));
}

TEST(LeafGrid, AddressesEveryLeafOnce) {
  EXPECT_TRUE(rc::check("leaf_at undoes address, and neighbours share a node's byte", [] {
    const LeafGrid grid = make_grid(*rc::gen::element(0.02, 0.05, 0.1));
    const LeafIndex leaf{*rc::gen::inRange(0, grid.leaves()[0]),
                         *rc::gen::inRange(0, grid.leaves()[1]),
                         *rc::gen::inRange(0, grid.leaves()[2])};
    const LeafAddress address = grid.address(leaf);
    RC_ASSERT(grid.leaf_at(address) == leaf);
    RC_ASSERT(address < grid.brick_count() * kBrickLeaves);
    const LeafIndex sibling{leaf[0] ^ 1, leaf[1] ^ 1, leaf[2] ^ 1};
    RC_ASSERT(grid.address(sibling) / 8 == address / 8);
    RC_ASSERT(grid.leaf_of(grid.centre(leaf)) == leaf);
  }));
}

TEST(LeafGrid, SaysWhatDoesNotFit) {
  using testing::HasSubstr;
  const Eigen::Vector3d min(0, 0, 0), max(6, 2.7, 2.4);
  EXPECT_TRUE(LeafGrid::cover(min, max, 0.02).has_value());
  EXPECT_THAT(LeafGrid::cover(min, max, 0.005).error().message, HasSubstr("0.01 to 0.10"));
  EXPECT_THAT(LeafGrid::cover(max, min, 0.02).error().message, HasSubstr("empty"));
  EXPECT_THAT(LeafGrid::cover(min, {200, 100, 10}, 0.02).error().message,
              HasSubstr("choose a leaf above"));
  EXPECT_THAT(LeafGrid::cover(min, {1e9, 1e9, 1e9}, 0.02).error().message,
              HasSubstr("choose a leaf above"));
  EXPECT_FALSE(LeafGrid::cover(min, {NAN, 1, 1}, 0.02).has_value());
}

}  // namespace
}  // namespace wagonsight
