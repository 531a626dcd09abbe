#include <gmock/gmock.h>
#include <lz4frame.h>
#include <zstd.h>

#include <cstring>

#include "unit/recording/synthetic_recording.h"

// rosbag2 writes lz4 chunks when told to. Ours are zstd, so a test packs them again.
namespace wagonsight {
namespace {

using testing::expect_frame;
using testing::OwnedSlot;

template <class T>
T number_at(std::span<const std::byte> bytes, std::size_t at) {
  T value{};
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

void append(std::vector<std::byte>& out, std::span<const std::byte> bytes) {
  const std::size_t at = out.size();
  out.resize(at + bytes.size());
  if (!bytes.empty()) std::memcpy(out.data() + at, bytes.data(), bytes.size());
}

template <class T>
void append_number(std::vector<std::byte>& out, T value) {
  append(out, std::as_bytes(std::span(&value, 1)));
}

std::vector<std::byte> lz4_of(std::span<const std::byte> zstd, std::size_t size) {
  std::vector<std::byte> plain(size);
  EXPECT_EQ(ZSTD_decompress(plain.data(), size, zstd.data(), zstd.size()), size);
  std::vector<std::byte> packed(LZ4F_compressFrameBound(size, nullptr));
  packed.resize(
      LZ4F_compressFrame(packed.data(), packed.size(), plain.data(), plain.size(), nullptr));
  return packed;
}

// The header and the chunks, as lz4, without the summary: a recording that a power cut ended.
std::vector<std::byte> with_lz4_chunks(std::span<const std::byte> recording) {
  constexpr std::size_t kFixed = 8 + 8 + 8 + 4;  // start, end, uncompressed size, CRC
  std::vector<std::byte> out;
  append(out, recording.first(kMcapMagic.size()));
  for (std::size_t at = kMcapMagic.size(); at + kMcapRecordHeaderBytes < recording.size();) {
    const auto opcode = static_cast<McapOpcode>(recording[at]);
    const auto length = number_at<std::uint64_t>(recording, at + 1);
    const auto content = recording.subspan(at + kMcapRecordHeaderBytes, length);
    const auto record = recording.subspan(at, kMcapRecordHeaderBytes + length);
    at += record.size();
    if (opcode == McapOpcode::kDataEnd) break;
    if (opcode == McapOpcode::kMessageIndex) continue;  // its places have moved
    if (opcode != McapOpcode::kChunk) {
      append(out, record);
      continue;
    }
    const std::size_t records_at = kFixed + 4 + 4 + 8;  // and "zstd" with its length, the size
    const auto packed = lz4_of(content.subspan(records_at), number_at<std::uint64_t>(content, 16));
    out.push_back(static_cast<std::byte>(McapOpcode::kChunk));
    append_number<std::uint64_t>(out, kFixed + 4 + 3 + 8 + packed.size());
    append(out, content.first(kFixed));
    append_number<std::uint32_t>(out, 3);
    append(out, std::as_bytes(std::span("lz4", 3)));
    append_number<std::uint64_t>(out, packed.size());
    append(out, packed);
  }
  return out;
}

TEST(Lz4Chunks, AreReadLikeOurs) {
  constexpr std::uint32_t kFrames = 9;
  const auto ours = testing::record(kFrames, {.chunk_bytes = 6000});
  const auto theirs = with_lz4_chunks(ours);
  const auto reader = RecordingReader::open(theirs, DamagePolicy::kStop);
  ASSERT_TRUE(reader.has_value()) << reader.error().message;
  ASSERT_GT((*reader)->mcap().segments().size(), 1U);
  OwnedSlot owned;
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    const auto more = (*reader)->next(owned.slot);
    ASSERT_TRUE(more.has_value()) << more.error().message;
    ASSERT_TRUE(*more);
    expect_frame(i, owned);
  }
  EXPECT_FALSE(*(*reader)->next(owned.slot));
}

TEST(Lz4Chunks, ThatAreDamagedAreTold) {
  auto bytes = with_lz4_chunks(testing::record(6, {.chunk_bytes = 6000}));
  bytes[bytes.size() - 40] ^= std::byte{0x55};
  const auto reader = RecordingReader::open(bytes, DamagePolicy::kStop);
  ASSERT_TRUE(reader.has_value());
  OwnedSlot owned;
  std::string told;
  for (int i = 0; i < 6 && told.empty(); ++i) {
    const auto more = (*reader)->next(owned.slot);
    if (!more) told = more.error().message;
  }
  EXPECT_THAT(told, ::testing::HasSubstr("is damaged"));
}

// Only one of the sensors, as if the others had never been recorded.
TEST(RecordingReader, ReadsOneSensorAlone) {
  const auto bytes = testing::record(6);
  const auto reader = RecordingReader::open(bytes, DamagePolicy::kStop);
  ASSERT_TRUE(reader.has_value());
  ASSERT_TRUE((*reader)->take_only("s-0").has_value());
  ASSERT_EQ((*reader)->rig().sensors.size(), 1U);
  EXPECT_EQ((*reader)->stated_frame_count(), 3U);
  OwnedSlot owned;
  for (std::uint32_t i = 1; i < 6; i += 2) {
    ASSERT_TRUE(*(*reader)->next(owned.slot));
    EXPECT_EQ(owned.slot.sensor_index, 0U);
    owned.slot.sensor_index = 1;
    expect_frame(i, owned);
  }
  EXPECT_FALSE(*(*reader)->next(owned.slot));
  const auto refused = (*reader)->take_only("k9");
  ASSERT_FALSE(refused.has_value());
  EXPECT_THAT(refused.error().message, ::testing::HasSubstr("has no sensor k9; it has s-0"));
}

}  // namespace
}  // namespace wagonsight
