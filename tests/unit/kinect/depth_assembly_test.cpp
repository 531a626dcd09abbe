#include "kinect/depth_assembly.h"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace wagonsight {
namespace {

constexpr KinectOptics kOptics{7.5, 120.0, 0.1042, 200.0};

std::vector<std::byte> packet(int number, std::byte filling = std::byte{0x5A}) {
  const auto at = static_cast<std::size_t>(number) * DepthAssembly::kPacketBytes;
  return std::vector<std::byte>(
      std::min<std::size_t>(DepthAssembly::kPacketBytes, DepthAssembly::kFrameBytes - at), filling);
}

TEST(DepthTable, GrowsWithTheRawValueAndEndsBeforeItsPole) {
  DepthTable table;
  ASSERT_TRUE(make_depth_table(kOptics, table));
  EXPECT_EQ(table[2047], 0);
  int last = 0;
  int readings = 0;
  for (std::size_t raw = 0; raw < 2047; ++raw) {
    if (table[raw] == 0) continue;
    EXPECT_GE(table[raw], last) << raw;
    last = table[raw];
    ++readings;
  }
  EXPECT_GT(readings, 1000);
  EXPECT_GT(last, 8000);
  EXPECT_LT(last, 10'000);
  // Where nothing is measured any more no value may wrap around to a near one.
  for (std::size_t raw = 1100; raw < 2048; ++raw) EXPECT_EQ(table[raw], 0) << raw;
}

TEST(DepthTable, RefusesOpticsOfNoKinect) {
  DepthTable table;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const KinectOptics& wrong :
       {KinectOptics{0, 120, 0.1042, 200}, KinectOptics{7.5, nan, 0.1042, 200},
        KinectOptics{7.5, 120, 0, 200}, KinectOptics{7.5, 120, 0.1042, 65535}}) {
    EXPECT_FALSE(make_depth_table(wrong, table));
    EXPECT_THAT(table, ::testing::Each(0));
  }
}

TEST(DepthAssembly, KnowsAWholeFrame) {
  DepthAssembly assembly;
  for (int frame = 0; frame < 3; ++frame) {
    for (int i = 0; i < DepthAssembly::kPackets; ++i) assembly.add(i, packet(i));
    EXPECT_TRUE(assembly.finish());
  }
}

TEST(DepthAssembly, KnowsEachHoleAndEachShortPacket) {
  for (int hole = 0; hole < DepthAssembly::kPackets; ++hole) {
    DepthAssembly lost;
    DepthAssembly cut;
    for (int i = 0; i < DepthAssembly::kPackets; ++i) {
      if (i != hole) lost.add(i, packet(i));
      const auto whole = packet(i);
      cut.add(i, std::span(whole).first(whole.size() - (i == hole ? 1 : 0)));
    }
    EXPECT_FALSE(lost.finish()) << hole;
    EXPECT_FALSE(cut.finish()) << hole;
  }
}

TEST(DepthAssembly, FrameThatTheNextOneEndedIsNotWhole) {
  DepthAssembly assembly;
  for (int i = 0; i < DepthAssembly::kPackets - 1; ++i) assembly.add(i, packet(i));
  assembly.add(0, packet(0));  // of the next frame; libfreenect then tells of the last one's end
  EXPECT_FALSE(assembly.finish());
  for (int i = 1; i < DepthAssembly::kPackets; ++i) assembly.add(i, packet(i));
  EXPECT_TRUE(assembly.finish());
}

TEST(DepthAssembly, IgnoresNumbersBeyondAFrame) {
  DepthAssembly assembly;
  assembly.add(-1, packet(0));
  assembly.add(DepthAssembly::kPackets, packet(0));
  assembly.add(std::numeric_limits<int>::max(), packet(0));
  EXPECT_FALSE(assembly.finish());
}

TEST(DepthAssembly, ConvertsAsABitByBitReader) {
  std::mt19937 random(7);
  std::vector<std::byte> bytes(DepthAssembly::kFrameBytes);
  for (std::byte& b : bytes) b = static_cast<std::byte>(random());
  DepthAssembly assembly;
  for (int i = 0; i < DepthAssembly::kPackets; ++i)
    assembly.add(i,
                 std::span(bytes).subspan(static_cast<std::size_t>(i) * DepthAssembly::kPacketBytes,
                                          packet(i).size()));
  ASSERT_TRUE(assembly.finish());
  DepthTable identity;
  for (std::size_t i = 0; i < identity.size(); ++i) identity[i] = static_cast<std::uint16_t>(i);
  std::vector<std::uint16_t> out(kKinectPixels);
  assembly.convert(identity, out);
  for (std::size_t p = 0; p < kKinectPixels; ++p) {
    unsigned raw = 0;
    for (std::size_t bit = p * 11; bit < p * 11 + 11; ++bit)
      raw = raw << 1U | (std::to_integer<unsigned>(bytes[bit / 8]) >> (7 - bit % 8) & 1U);
    ASSERT_EQ(out[p], raw) << p;
  }
}

}  // namespace
}  // namespace wagonsight
