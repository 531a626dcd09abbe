#include "iidc/packet_plan.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

namespace wagonsight {
namespace {

constexpr std::int64_t kPairBytes = 769 * 448 * 2 * 2;

TEST(PacketPlan, SixUnitsFitOnThreeBusesAtFourteenHertz) {
  const PacketPlan plan = plan_packets({kPairBytes, 2});
  EXPECT_LE(2 * plan.units, kFireUnitsOfBus);
  EXPECT_GE(plan.rate_hz, 14.0);
}

TEST(PacketPlan, ReservesNoMoreThanARateNeeds) {
  const PacketPlan plan = plan_packets({kPairBytes, 1, 5});
  EXPECT_GE(plan.rate_hz, 5.0);
  EXPECT_LT(plan.rate_hz, 5.1);
}

TEST(PacketPlan, SaysWhatDoesNotFit) {
  EXPECT_EQ(plan_packets({kPairBytes, 1000}).packet_bytes, 0);
  EXPECT_EQ(plan_packets({kPairBytes, 1, 0, 8192, 4096}).packet_bytes, 0);
}

RC_GTEST_PROP(PacketPlan, KeepsEveryLimit, ()) {
  PacketWish wish;
  wish.image_bytes = *rc::gen::inRange<std::int64_t>(1, 4'000'000);
  wish.cameras_on_bus = *rc::gen::inRange(1, 20);
  wish.rate_hz_max = *rc::gen::inRange(0, 60);
  wish.unit_bytes = *rc::gen::inRange(1, 300);
  wish.packet_bytes_max = *rc::gen::inRange(4, 4097);
  const PacketPlan plan = plan_packets(wish);
  if (plan.packet_bytes == 0) return;
  RC_ASSERT(plan.packet_bytes % wish.unit_bytes == 0);
  RC_ASSERT(plan.packet_bytes % 4 == 0);
  RC_ASSERT(plan.packet_bytes <= wish.packet_bytes_max);
  RC_ASSERT(plan.units * wish.cameras_on_bus <= kFireUnitsOfBus);
  RC_ASSERT(std::int64_t{plan.packets} * plan.packet_bytes >= wish.image_bytes);
  RC_ASSERT(std::int64_t{plan.packets - 1} * plan.packet_bytes < wish.image_bytes);
}

}  // namespace
}  // namespace wagonsight
