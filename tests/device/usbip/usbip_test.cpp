#include <gmock/gmock.h>
#include <rapidcheck.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <initializer_list>

#include "kinect_unit.h"
#include "usbip_line.h"
#include "usbip_wire.h"
#include "vhci_ports.h"

namespace wagonsight::device::usbip {
namespace {

using Bytes = std::vector<std::uint8_t>;
using ::testing::ElementsAre;

// Big-endian numbers, as the kernel packs them (drivers/usb/usbip/usbip_common.c).
Bytes numbers(std::initializer_list<std::uint32_t> values) {
  Bytes bytes;
  for (const std::uint32_t value : values)
    for (const unsigned shift : {24U, 16U, 8U, 0U})
      bytes.push_back(static_cast<std::uint8_t>(value >> shift));
  return bytes;
}
std::uint32_t number_of(const Bytes& bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value = value << 8U | bytes[4 * at + i];
  return value;
}

struct Ask {
  std::uint8_t type = 0, request = 0;
  std::uint16_t value = 0, index = 0, length = 0;
};
Bytes submit(std::uint32_t sequence, bool is_in, std::uint32_t endpoint, std::uint32_t length,
             std::uint32_t packets, const Ask& setup = {}) {
  Bytes bytes =
      numbers({1, sequence, 0x10002, is_in ? 1U : 0U, endpoint, 0, length, 0, packets, 1});
  const std::array<std::uint16_t, 3> words{setup.value, setup.index, setup.length};
  bytes.push_back(setup.type);
  bytes.push_back(setup.request);
  for (const std::uint16_t word : words) {
    bytes.push_back(static_cast<std::uint8_t>(word));
    bytes.push_back(static_cast<std::uint8_t>(word >> 8U));
  }
  return bytes;
}
Bytes unlink(std::uint32_t sequence, std::uint32_t victim) {
  Bytes bytes = numbers({2, sequence, 0x10002, 0, 0, victim});
  bytes.resize(kHeaderBytes);
  return bytes;
}
std::optional<Request> decoded(const Bytes& bytes) {
  return decode_request(std::span<const std::uint8_t, kHeaderBytes>(bytes.data(), kHeaderBytes));
}

TEST(UsbipWire, UnderstandsWhatTheKernelSubmits) {
  const auto request = decoded(submit(7, true, 0, 64, 0xffffffff, {0x80, 6, 0x0302, 0x0409, 64}));
  ASSERT_TRUE(request);
  EXPECT_FALSE(request->is_unlink);
  EXPECT_EQ(request->sequence, 7U);
  EXPECT_TRUE(request->is_in);
  EXPECT_EQ(request->endpoint, 0x80);
  EXPECT_EQ(request->length, 64);
  EXPECT_EQ(request->packets, 0);
  EXPECT_EQ(request->setup.request_type, 0x80);
  EXPECT_EQ(request->setup.request, 6);
  EXPECT_EQ(request->setup.value, 0x0302);
  EXPECT_EQ(request->setup.index, 0x0409);
  EXPECT_EQ(request->setup_length, 64);
  EXPECT_EQ(request->bytes_out(), 0U);
  EXPECT_EQ(decoded(submit(8, false, 0, 10, 0))->bytes_out(), 10U);
  const auto packets = decoded(submit(9, true, 2, 16 * 1760, 16));
  EXPECT_EQ(packets->endpoint, 0x82);
  EXPECT_EQ(packets->description_bytes(), 16U * 16);
}

TEST(UsbipWire, UnderstandsThatATransferIsTakenBack) {
  const auto request = decoded(unlink(12, 11));
  ASSERT_TRUE(request);
  EXPECT_TRUE(request->is_unlink);
  EXPECT_EQ(request->victim, 11U);
  EXPECT_EQ(request->bytes_out() + request->description_bytes(), 0U);
}

TEST(UsbipWire, RefusesWhatNoKernelSays) {
  EXPECT_FALSE(decoded(Bytes(kHeaderBytes, 0)));
  EXPECT_FALSE(decoded(submit(1, true, 16, 8, 0)));
  EXPECT_FALSE(decoded(submit(1, true, 2, 0x80000000, 0)));
  EXPECT_FALSE(decoded(submit(1, true, 2, 8, kPacketsMax + 1)));
  Bytes answer = submit(1, true, 2, 8, 0);
  answer[3] = 3;
  EXPECT_FALSE(decoded(answer));
}

TEST(UsbipWire, NeverTakesMoreThanItsLimitsFromAnyHeader) {
  rc::check("any header", [] {
    const auto bytes = *rc::gen::container<Bytes>(kHeaderBytes, rc::gen::arbitrary<std::uint8_t>());
    Bytes header = bytes;
    header[0] = header[1] = header[2] = 0;
    header[3] = static_cast<std::uint8_t>(1 + header[3] % 2);
    const auto request = decoded(header);
    if (!request) return;
    RC_ASSERT(request->bytes_out() <= std::size_t{kTransferBytesMax});
    RC_ASSERT(request->description_bytes() <= kPacketsMax * kDescriptionBytes);
  });
}

TEST(UsbipWire, PacksIsochronousPacketsWithoutGaps) {
  Request request;
  request.sequence = 5;
  Bytes bytes;
  SubmitReply reply(bytes);
  for (const std::uint8_t length : Bytes{3, 0, 2}) {
    const auto room = reply.room(8);
    std::fill(room.begin(), room.end(), std::uint8_t{0xee});
    std::fill_n(room.begin(), length, length);
    reply.came(length);
  }
  reply.finish(request, 0,
               std::array<PacketDescription, 3>{{{0, 8, 3, 0}, {8, 8, 0, -EILSEQ}, {16, 8, 2, 0}}});
  const Bytes head(bytes.begin(), bytes.begin() + kHeaderBytes);
  EXPECT_EQ(number_of(head, 0), 3U);
  EXPECT_EQ(number_of(head, 1), 5U);
  EXPECT_EQ(number_of(head, 5), 0U);  // status
  EXPECT_EQ(number_of(head, 6), 5U);  // bytes
  EXPECT_EQ(number_of(head, 8), 3U);  // packets
  EXPECT_EQ(number_of(head, 9), 1U);  // errors
  const Bytes came(bytes.begin() + kHeaderBytes, bytes.begin() + kHeaderBytes + 5);
  EXPECT_THAT(came, ElementsAre(3, 3, 3, 2, 2));
  const Bytes descriptions(bytes.begin() + kHeaderBytes + 5, bytes.end());
  EXPECT_EQ(descriptions,
            numbers({0, 8, 3, 0, 8, 8, 0, static_cast<std::uint32_t>(-EILSEQ), 16, 8, 2, 0}));
}

TEST(UsbipWire, DescriptionsSurviveTheWire) {
  rc::check("round trip", [](std::uint32_t offset, std::uint32_t length, std::uint32_t actual,
                             std::int32_t status) {
    Bytes bytes;
    SubmitReply(bytes).finish({}, 0,
                              std::array<PacketDescription, 1>{{{offset, length, actual, status}}});
    RC_ASSERT(bytes.size() == kHeaderBytes + kDescriptionBytes);
    const auto again = decode_description(std::span<const std::uint8_t, kDescriptionBytes>(
        bytes.data() + kHeaderBytes, kDescriptionBytes));
    RC_ASSERT(again.offset == offset && again.length == length);
    RC_ASSERT(again.actual_length == actual && again.status == status);
  });
}

TEST(VhciPorts, TakesTheFirstFreeHighSpeedOne) {
  constexpr const char* kStatus =
      "hub port sta spd dev      sockfd local_busid\n"
      "hs  0030 006 003 0001001f 000003 3-1\n"
      "hs  0031 004 000 00000000 000000 0-0\n"
      "hs  0032 004 000 00000000 000000 0-0\n"
      "ss  0045 004 000 00000000 000000 0-0\n";
  EXPECT_EQ(free_port(kStatus), 31);
  EXPECT_EQ(free_port(kStatus, 31), 32);
  EXPECT_EQ(free_port("hub port sta\nss  0045 004 000\n"), std::nullopt);
  EXPECT_EQ(free_port(""), std::nullopt);
}

// The test is the kernel; the device is a Kinect.
class UsbipLineToAKinect : public testing::Test {
 protected:
  void SetUp() override {
    KinectUnit::Options options;
    options.serial = "A00123";
    options.feed = [](std::uint32_t number, Nanoseconds /*light*/, std::span<std::uint16_t> raw) {
      paint_test_pattern(0, number, raw);
    };
    unit_ = std::make_unique<KinectUnit>(options);
    std::array<int, 2> ends{};
    ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()), 0);
    kernel_ = ends[0];
    line_ = std::make_unique<UsbipLine>(*unit_, mutex_, ends[1]);
  }
  void TearDown() override { close(kernel_); }

  void say(const Bytes& bytes) const {
    ASSERT_EQ(send(kernel_, bytes.data(), bytes.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(bytes.size()));
  }
  Bytes hear(std::size_t count) const {
    Bytes bytes(count);
    EXPECT_EQ(recv(kernel_, bytes.data(), count, MSG_WAITALL), static_cast<ssize_t>(count));
    return bytes;
  }
  // A control request and its answer's data; the status in place of it when it is refused.
  Bytes ask(const Ask& setup, const Bytes& out = {}) {
    const bool is_in = (setup.type & 0x80U) != 0;
    Bytes message = submit(++sequence_, is_in, 0, setup.length, 0, setup);
    message.insert(message.end(), out.begin(), out.end());
    say(message);
    const Bytes head = hear(kHeaderBytes);
    EXPECT_EQ(number_of(head, 0), 3U);
    EXPECT_EQ(number_of(head, 1), sequence_);
    if (number_of(head, 5) != 0) return {head.begin() + 20, head.begin() + 24};
    return is_in ? hear(number_of(head, 6)) : Bytes{};
  }
  void start_depth() {
    // "GM", two words, command 3, tag 1: register 6 becomes 2.
    const Bytes order = {'G', 'M', 2, 0, 3, 0, 1, 0, 6, 0, 2, 0};
    EXPECT_TRUE(ask({0x40, 0, 0, 0, static_cast<std::uint16_t>(order.size())}, order).empty());
  }

  std::mutex mutex_;
  std::unique_ptr<KinectUnit> unit_;
  int kernel_ = -1;
  std::unique_ptr<UsbipLine> line_;
  std::uint32_t sequence_ = 0;
};

TEST_F(UsbipLineToAKinect, TellsItsDescriptors) {
  const Bytes device = ask({0x80, 6, 0x0100, 0, 64});
  ASSERT_EQ(device.size(), 18U);
  EXPECT_THAT(Bytes(device.begin() + 8, device.begin() + 12), ElementsAre(0x5e, 0x04, 0xae, 0x02));
  EXPECT_EQ(ask({0x80, 6, 0x0200, 0, 9}).size(), 9U);
  const Bytes configuration = ask({0x80, 6, 0x0200, 0, 255});
  ASSERT_EQ(configuration.size(), 32U);
  EXPECT_EQ(configuration[2], 32);
  EXPECT_THAT(ask({0x80, 6, 0x0303, 0x0409, 255}),
              ElementsAre(14, 3, 'A', 0, '0', 0, '0', 0, '1', 0, '2', 0, '3', 0));
  EXPECT_EQ(ask({0x80, 6, 0x0600, 0, 10}), numbers({static_cast<std::uint32_t>(-EPIPE)}));
}

// Within a transfer; between two of them a busy machine may lose microframes, as a bus would.
TEST_F(UsbipLineToAKinect, StreamsDepthInConsecutiveMicroframes) {
  start_depth();
  constexpr std::uint32_t kPackets = 590;  // 74 ms
  Bytes message = submit(100, true, 2, kPackets * 1760, kPackets);
  for (std::uint32_t i = 0; i < kPackets; ++i) {
    const Bytes description = numbers({i * 1760, 1760, 0, 0});
    message.insert(message.end(), description.begin(), description.end());
  }
  say(message);
  const Bytes head = hear(kHeaderBytes);
  ASSERT_EQ(number_of(head, 1), 100U);
  ASSERT_EQ(number_of(head, 8), kPackets);
  const Bytes data = hear(number_of(head, 6));
  const Bytes descriptions = hear(kPackets * kDescriptionBytes);
  std::uint32_t packets = 0;
  std::size_t at = 0;
  int last_sequence = -1;
  for (std::uint32_t i = 0; i < kPackets; ++i) {
    const std::uint32_t length = number_of(descriptions, 4 * i + 2);
    if (length == 0) continue;
    ASSERT_LE(at + length, data.size());
    EXPECT_EQ(data[at], 'R');
    const int sequence = data[at + 5];
    if (last_sequence >= 0) {
      EXPECT_EQ(sequence, (last_sequence + 1) % 256);
    }
    last_sequence = sequence;
    at += length;
    ++packets;
  }
  EXPECT_EQ(at, data.size());
  EXPECT_GE(packets, 242U);  // a whole frame at least
}

TEST_F(UsbipLineToAKinect, TakesBackWhatItHasNotAnswered) {
  // A wedged Kinect leaves a request without an answer.
  {
    const std::lock_guard hold(mutex_);
    unit_->faults.wedged = true;
  }
  say(submit(50, true, 0, 64, 0, {0xc0, 0, 0, 0, 64}));
  say(unlink(51, 50));
  Bytes head = hear(kHeaderBytes);
  EXPECT_EQ(number_of(head, 0), 4U);
  EXPECT_EQ(number_of(head, 1), 51U);
  EXPECT_EQ(number_of(head, 5), static_cast<std::uint32_t>(-ECONNRESET));
  say(unlink(52, 50));
  head = hear(kHeaderBytes);
  EXPECT_EQ(number_of(head, 5), 0U);
}

TEST_F(UsbipLineToAKinect, EndsWhenEitherSidePullsThePlug) {
  line_.reset();
  std::uint8_t byte = 0;
  EXPECT_EQ(recv(kernel_, &byte, 1, 0), 0);
}

TEST_F(UsbipLineToAKinect, HangsUpWhenTheLineIsOutOfStep) {
  say(Bytes(kHeaderBytes, 0xff));
  line_.reset();  // its thread has ended, or this would hang
}

}  // namespace
}  // namespace wagonsight::device::usbip
