#include "iidc/pair_assembly.h"

#include <gtest/gtest.h>

#include <vector>

namespace wagonsight {
namespace {

// A camera of 6 x 4 pixels an image that sends 20 bytes a packet: 96 bytes in 5 packets.
class PairAssemblyTest : public ::testing::Test {
 protected:
  static constexpr int kWidth = 6, kHeight = 4, kPacketBytes = 20, kPackets = 5;

  PairAssemblyTest() : pixels_(kWidth * kHeight * 2) {
    wire_.resize(kPackets * kPacketBytes, std::byte{0xEE});
    for (std::size_t i = 0; i < pixels_.size(); ++i) {
      wire_[2 * i] = static_cast<std::byte>(i >> 4U);
      wire_[2 * i + 1] = static_cast<std::byte>(i << 4U);
    }
  }

  IsoPacket packet(int number) {
    IsoPacket packet;
    packet.length = kPacketBytes;
    packet.begins_image = number == 0;
    packet.stamp = stamp_;
    packet.payload =
        std::span(wire_).subspan(static_cast<std::size_t>(number * kPacketBytes), kPacketBytes);
    stamp_ = static_cast<std::uint16_t>((stamp_ & 0x1fff) == 7999 ? 0x2000 * ((stamp_ >> 13) + 1)
                                                                  : stamp_ + 1);
    return packet;
  }
  PairAssembly::Step send(int from = 0, int to = kPackets) {
    PairAssembly::Step all;
    for (int i = from; i < to; ++i) {
      const PairAssembly::Step step = assembly_.add(packet(i), pixels_);
      all.completes = all.completes || step.completes;
      all.lost_one = all.lost_one || step.lost_one;
    }
    return all;
  }

  PairAssembly assembly_{{kWidth, kHeight, PairLayout::kLeftAboveRight, kPacketBytes, kPackets, 4}};
  std::vector<std::byte> wire_;
  std::vector<std::uint16_t> pixels_;
  std::uint16_t stamp_ = 0xE000 | 7998;  // the eight seconds end within the first image
};

TEST_F(PairAssemblyTest, WholeImageIsTakenAndShiftedDown) {
  const PairAssembly::Step step = send();
  EXPECT_TRUE(step.completes);
  EXPECT_FALSE(step.lost_one);
  for (std::size_t i = 0; i < pixels_.size(); ++i) EXPECT_EQ(pixels_[i], i);
  EXPECT_TRUE(send().completes);
}

TEST_F(PairAssemblyTest, ImagesBesideEachOtherAreParted) {
  assembly_ =
      PairAssembly({kWidth, kHeight, PairLayout::kLeftBesideRight, kPacketBytes, kPackets, 4});
  EXPECT_TRUE(send().completes);
  for (std::size_t row = 0; row < kHeight; ++row)
    for (std::size_t column = 0; column < kWidth; ++column) {
      EXPECT_EQ(pixels_[row * kWidth + column], row * 2 * kWidth + column);
      EXPECT_EQ(pixels_[(kHeight + row) * kWidth + column], row * 2 * kWidth + kWidth + column);
    }
}

TEST_F(PairAssemblyTest, LostPacketsDamageTheirOwnImageOnly) {
  for (int lost = 0; lost < kPackets; ++lost) {
    const PairAssembly::Step begin = send(0, lost);
    stamp_ = static_cast<std::uint16_t>(stamp_ + 1);
    const PairAssembly::Step end = send(lost + 1);
    EXPECT_FALSE(begin.completes || end.completes) << lost;
    const PairAssembly::Step next = send();
    EXPECT_TRUE(next.completes) << lost;
    EXPECT_TRUE(end.lost_one || next.lost_one) << lost;
    EXPECT_FALSE(send().lost_one) << lost;
    stamp_ = 100;
  }
}

// As when the host had no buffers for a while: the count of packets is right, the image is not.
TEST_F(PairAssemblyTest, PartsOfTwoImagesAreNoImage) {
  send(0, 2);
  stamp_ = static_cast<std::uint16_t>(stamp_ + 50);
  EXPECT_FALSE(send(2).completes);
}

TEST_F(PairAssemblyTest, ShortPacketsDamageAndEmptyOnesDoNot) {
  IsoPacket empty = packet(1);
  empty.length = 0;
  send(0, 2);
  empty.stamp = stamp_;
  stamp_ = static_cast<std::uint16_t>(stamp_ + 1);
  EXPECT_FALSE(assembly_.add(empty, pixels_).lost_one);
  EXPECT_TRUE(send(2).completes);

  send(0, 2);
  IsoPacket cut = packet(2);
  cut.length = 8;
  cut.payload = cut.payload.first(8);
  assembly_.add(cut, pixels_);
  const PairAssembly::Step end = send(3);
  EXPECT_FALSE(end.completes);
  EXPECT_TRUE(end.lost_one);
}

}  // namespace
}  // namespace wagonsight
