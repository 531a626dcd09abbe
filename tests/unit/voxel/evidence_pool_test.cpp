#include "voxel/evidence_pool.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <map>
#include <set>

namespace wagonsight {
namespace {

TEST(EvidencePool, IsAMapOfLeaves) {
  EXPECT_TRUE(rc::check("writes, reads and forgotten bricks equal a std::map", [] {
    const auto grid = LeafGrid::cover({0, 0, 0}, {3, 3, 3}, 0.05);
    EvidencePool pool(*grid);
    std::map<LeafAddress, std::uint8_t> twin;
    std::set<BrickAddress> bricks;
    std::set<std::uint32_t> nodes;  // of 64 leaves
    const int steps = *rc::gen::inRange(0, 300);
    for (int i = 0; i < steps; ++i) {
      const auto leaf = *rc::gen::inRange<LeafAddress>(0, 40 * 512);
      if (*rc::gen::inRange(0, 10) == 0) {
        const BrickAddress brick = leaf / 512;
        pool.forget(brick);
        bricks.erase(brick);
        nodes.erase(nodes.lower_bound(brick * 8), nodes.lower_bound((brick + 1) * 8));
        twin.erase(twin.lower_bound(brick * 512), twin.lower_bound((brick + 1) * 512));
      } else {
        LeafEvidence* evidence = pool.find_or_add(leaf);
        RC_ASSERT(evidence != nullptr);
        RC_ASSERT(evidence->hits == twin[leaf]);
        evidence->hits = ++twin[leaf];
        bricks.insert(leaf / 512);
        nodes.insert(leaf / 64);
      }
      const auto asked = *rc::gen::inRange<LeafAddress>(0, 40 * 512);
      const LeafEvidence* found = pool.find(asked);
      RC_ASSERT((found != nullptr) == nodes.contains(asked / 64));
      if (found != nullptr) {
        const auto known = twin.find(asked);
        RC_ASSERT(found->hits == (known == twin.end() ? 0 : known->second));
      }
    }
    const auto listed = pool.bricks();
    RC_ASSERT(std::set<BrickAddress>(listed.begin(), listed.end()) == bricks);
    RC_ASSERT(listed.size() == bricks.size());
    std::set<std::uint32_t> visited;
    for (const BrickAddress brick : listed) {
      pool.visit_brick(brick, [&](LeafAddress leaf, LeafEvidence& evidence) {
        visited.insert(leaf / 64);
        const auto known = twin.find(leaf);
        RC_ASSERT(evidence.hits == (known == twin.end() ? 0 : known->second));
      });
    }
    RC_ASSERT(visited == nodes);
  }));
}

TEST(EvidencePool, RemembersWhatWasSeenInThisRoundAndTheOneBefore) {
  EXPECT_TRUE(rc::check("the sets of two rounds equal those of a std::map", [] {
    const auto grid = LeafGrid::cover({0, 0, 0}, {0.6, 0.6, 0.6}, 0.02);
    EvidencePool pool(*grid);
    std::map<LeafAddress, std::uint32_t> last_seen;    // its last round
    std::map<LeafAddress, std::uint32_t> seen_before;  // the one before that
    std::uint32_t round = 2;
    const int steps = *rc::gen::inRange(0, 200);
    for (int i = 0; i < steps; ++i) {
      if (*rc::gen::inRange(0, 5) == 0) round += *rc::gen::inRange<std::uint32_t>(1, 4);
      const auto leaf = *rc::gen::inRange<LeafAddress>(0, 1200);
      (void)pool.find_or_add(leaf);
      const auto at_round = [&](std::uint32_t when) {
        return (last_seen.count(leaf) != 0 && last_seen[leaf] == when) ||
               (seen_before.count(leaf) != 0 && seen_before[leaf] == when);
      };
      RC_ASSERT(pool.seen(leaf, round) == at_round(round));
      RC_ASSERT(pool.seen_lately(leaf, round) == (at_round(round) || at_round(round - 1)));
      if (!*rc::gen::arbitrary<bool>()) continue;
      RC_ASSERT(pool.see(leaf, round) == !at_round(round));
      if (at_round(round)) continue;
      if (last_seen.count(leaf) != 0) seen_before[leaf] = last_seen[leaf];
      last_seen[leaf] = round;
    }
  }));
}

TEST(EvidencePool, RefusesAndCountsWhenUsedUp) {
  const auto grid = LeafGrid::cover({0, 0, 0}, {3, 3, 3}, 0.05);
  ASSERT_TRUE(grid.has_value());
  constexpr std::size_t kNodes = 100;
  EvidencePool pool(*grid, kNodes);
  ASSERT_EQ(pool.capacity(), kNodes);
  ASSERT_EQ(pool.brick_capacity(), kNodes / 2);
  for (LeafAddress node = 0; node < kNodes; ++node) {
    ASSERT_NE(pool.find_or_add(node * 64 + 5), nullptr);
  }
  EXPECT_EQ(pool.find_or_add(kNodes * 64), nullptr);
  EXPECT_EQ(pool.refused(), 1U);
  EXPECT_EQ(pool.high_water(), kNodes);
  pool.forget(7);
  EXPECT_NE(pool.find_or_add(kNodes * 64), nullptr);
  // Bricks are used up, too, by one node each.
  pool.clear();
  for (BrickAddress brick = 0; brick < kNodes / 2; ++brick) {
    ASSERT_NE(pool.find_or_add(brick * 512), nullptr);
  }
  EXPECT_EQ(pool.find_or_add(kNodes / 2 * 512), nullptr);
  EXPECT_EQ(pool.refused(), 2U);
  EXPECT_NE(pool.find_or_add(64), nullptr);  // another node of a known brick
}

}  // namespace
}  // namespace wagonsight
