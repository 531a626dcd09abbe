#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <string>

#include "synthetic_recording.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;
using namespace wagonsight::testing;  // NOLINT: the helpers of this folder

McapWriterOptions small_chunks() {
  McapWriterOptions options;
  options.chunk_bytes = 4096;  // two frames
  return options;
}

TEST(Recording, GivesBackEveryFrameAsItWas) {
  const auto bytes = record(20, small_chunks());
  auto reader = RecordingReader::open(bytes, DamagePolicy::kStop);
  ASSERT_TRUE(reader.has_value()) << reader.error().message;
  OwnedSlot owned;
  ASSERT_LE((*reader)->slot_bytes(), owned.memory.size());
  for (std::uint32_t i = 0; i < 20; ++i) {
    const auto more = (*reader)->next(owned.slot);
    ASSERT_TRUE(more.has_value()) << more.error().message;
    ASSERT_TRUE(*more);
    expect_frame(i, owned);
  }
  EXPECT_FALSE(*(*reader)->next(owned.slot));
}

TEST(Recording, CarriesTheRigAsItsBlob) {
  const auto bytes = record(2);
  auto reader = RecordingReader::open(bytes, DamagePolicy::kStop);
  ASSERT_TRUE(reader.has_value()) << reader.error().message;
  EXPECT_TRUE((*reader)->has_blob());
  const Rig& rig = (*reader)->rig();
  ASSERT_EQ(rig.sensors.size(), 2U);
  EXPECT_EQ(rig.sensors[0].camera.distortion, small_rig().sensors[0].camera.distortion);
  EXPECT_EQ(rig.sensors[1].stereo.baseline, 0.24);
  EXPECT_EQ((*reader)->rays()[0].size(), std::size_t{kWidth} * kHeight);
}

TEST(Recording, IsTheSameBytesEveryTime) {
  EXPECT_EQ(record(9, small_chunks()), record(9, small_chunks()));
}

TEST(Recording, RewindsAndSeeks) {
  const auto bytes = record(40, small_chunks());
  auto reader = RecordingReader::open(bytes, DamagePolicy::kStop);
  ASSERT_TRUE(reader.has_value());
  OwnedSlot owned;
  OwnedSlot wanted;
  fill_frame(30, wanted);
  (*reader)->seek(wanted.slot.arrival);
  ASSERT_TRUE(*(*reader)->next(owned.slot));
  EXPECT_LE(owned.slot.arrival, wanted.slot.arrival);
  EXPECT_GE(owned.slot.sequence, 1000U + 26U) << "chunks before were not skipped";
  (*reader)->rewind();
  ASSERT_TRUE(*(*reader)->next(owned.slot));
  expect_frame(0, owned);
}

TEST(Recording, GivesWhatTheTrainHadSaidByEachFrame) {
  MemorySink sink;
  RecordingOptions options;
  options.has_vehicle = true;
  auto writer = *RecordingWriter::create(sink, small_rig(), options);
  OwnedSlot owned;
  for (std::uint32_t i = 0; i < 6; ++i) {
    VehicleStateMessage said;
    said.doors = {{"north", i < 4 ? VehicleStateMessage::kOpen : VehicleStateMessage::kClosed}};
    fill_frame(i, owned);
    said.stamp = owned.slot.arrival;
    if (i == 2 || i == 4) {
      ASSERT_TRUE(writer->write(said));
    }
    ASSERT_TRUE(writer->write(owned.slot));
  }
  ASSERT_TRUE(writer->finish());
  auto reader = *RecordingReader::open(sink.bytes(), DamagePolicy::kStop);
  for (const bool listens : {false, true}) {
    if (listens) reader->listen_to_vehicle();
    reader->rewind();
    for (std::uint32_t i = 0; i < 6; ++i) {
      ASSERT_TRUE(*reader->next(owned.slot));
      ASSERT_EQ(reader->vehicle() != nullptr, listens && i >= 2) << i;
      if (reader->vehicle() == nullptr) continue;
      ASSERT_EQ(reader->vehicle()->doors.size(), 1U);
      EXPECT_EQ(reader->vehicle()->doors[0].name, "north");
      EXPECT_EQ(reader->vehicle()->doors[0].state,
                i < 4 ? VehicleStateMessage::kOpen : VehicleStateMessage::kClosed);
    }
  }
}

// A damaged byte within the third chunk's compressed records.
std::vector<std::byte> damaged_recording() {
  auto bytes = record(20, small_chunks());
  const auto reader = McapReader::open(bytes);
  const McapSegment third = reader->segments().at(2);
  bytes[static_cast<std::size_t>(third.offset + third.length / 2)] ^= std::byte{0x10};
  return bytes;
}

TEST(Recording, NamesADamagedChunkAndStops) {
  const auto bytes = damaged_recording();
  auto reader = RecordingReader::open(bytes, DamagePolicy::kStop);
  ASSERT_TRUE(reader.has_value());
  OwnedSlot owned;
  std::uint32_t frames = 0;
  while (true) {
    const auto more = (*reader)->next(owned.slot);
    if (!more) {
      EXPECT_THAT(more.error().message, HasSubstr("chunk 3 of "));
      EXPECT_THAT(more.error().message, HasSubstr("is damaged"));
      break;
    }
    ASSERT_TRUE(*more) << "the damage was not noticed";
    expect_frame(frames++, owned);
  }
  EXPECT_GT(frames, 0U);
}

TEST(Recording, SkipsADamagedChunkWhenAsked) {
  const auto bytes = damaged_recording();
  auto reader = RecordingReader::open(bytes, DamagePolicy::kSkip);
  ASSERT_TRUE(reader.has_value());
  OwnedSlot owned;
  std::uint32_t frames = 0;
  while (*(*reader)->next(owned.slot)) {
    expect_frame(owned.slot.sequence - 1000, owned);
    ++frames;
  }
  EXPECT_EQ((*reader)->cursor().damaged_chunks(), 1U);
  EXPECT_LT(frames, 20U);
  EXPECT_GT(frames, 14U);
}

TEST(Recording, TruncatedAnywhereGivesEveryWholeChunkBefore) {
  const auto bytes = record(12, small_chunks());
  const auto whole = McapReader::open(bytes);
  ASSERT_TRUE(whole.has_value());
  ASSERT_TRUE(whole->complete());
  ASSERT_GE(whole->segments().size(), 4U);
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    const auto cut = std::span(bytes).first(size);
    std::size_t chunks = 0;
    for (const McapSegment& chunk : whole->segments())
      if (chunk.offset + chunk.length <= size) ++chunks;
    auto reader = RecordingReader::open(cut, DamagePolicy::kStop);
    if (!reader) {
      ASSERT_EQ(chunks, 0U) << "cut at " << size << ": " << reader.error().message;
      continue;
    }
    ASSERT_FALSE((*reader)->mcap().complete()) << "cut at " << size;
    ASSERT_EQ((*reader)->mcap().segments().size(), chunks) << "cut at " << size;
    // The frames themselves are looked at where a chunk has just become whole.
    const bool is_edge =
        std::any_of(whole->segments().begin(), whole->segments().end(),
                    [&](const McapSegment& chunk) { return chunk.offset + chunk.length == size; });
    if (!is_edge) continue;
    OwnedSlot owned;
    std::uint32_t frames = 0;
    while (*(*reader)->next(owned.slot)) expect_frame(frames++, owned);
    ASSERT_GE(frames, chunks) << "cut at " << size;
  }
}

TEST(Recording, RefusesWhatIsNoRecordingByName) {
  const auto message_for = [](std::string_view text) {
    const auto reader = RecordingReader::open(std::as_bytes(std::span(text.data(), text.size())),
                                              DamagePolicy::kStop);
    return reader ? std::string("accepted") : reader.error().message;
  };
  EXPECT_THAT(message_for(""), HasSubstr("is empty"));
  EXPECT_THAT(message_for("PK\x03\x04 a zip file"), HasSubstr("is not an MCAP recording"));
  EXPECT_THAT(message_for("\x89MCAP1\r\n"), HasSubstr("version '1'"));
  EXPECT_THAT(message_for("\x89MCAP0\r\n"), HasSubstr("ends within its header"));
}

TEST(Recording, RefusesADamagedBlob) {
  auto bytes = record(2);
  const std::string_view text{reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  const std::size_t at = text.find("application/x-wagonsight-rig");
  ASSERT_NE(at, std::string_view::npos);
  bytes[at + 100] ^= std::byte{1};
  const auto reader = RecordingReader::open(bytes, DamagePolicy::kStop);
  ASSERT_FALSE(reader.has_value());
  EXPECT_THAT(reader.error().message, HasSubstr("\"rig.blob\""));
}

// As rosbag2 writes: no blob, its own topics, schemas in the chunks' place does not matter.
std::vector<std::byte> foreign_recording(bool with_camera, bool big_endian) {
  MemorySink sink;
  auto mcap = McapWriter::create(sink, {});
  EXPECT_TRUE(mcap.has_value());
  McapWriter& writer = **mcap;
  const auto image_id = *writer.add_schema(image_schema().name, "ros2msg", image_schema().text);
  const auto info_id =
      *writer.add_schema(camera_info_schema().name, "ros2msg", camera_info_schema().text);
  const auto image_topic = *writer.add_channel(image_id, "/front/depth/image_rect_raw", "cdr", {});
  const auto info_topic = *writer.add_channel(info_id, "/front/depth/camera_info", "cdr", {});
  ByteWriter body;
  CameraInfoMessage info;
  info.camera = small_rig().sensors[0].camera;
  encode_camera_info(info, body);
  if (with_camera) writer.add_message({.channel_id = info_topic, .data = {}}, {body.bytes()});
  for (std::uint32_t i = 0; i < 3; ++i) {
    std::vector<std::byte> pixels;
    for (int row = 0; row < kHeight; ++row) {
      for (int u = 0; u < kWidth; ++u) {
        const auto depth = static_cast<std::uint16_t>(1000 + i * 100 + static_cast<unsigned>(u));
        const auto high = static_cast<std::byte>(depth >> 8U);
        const auto low = static_cast<std::byte>(depth & 0xFFU);
        pixels.push_back(big_endian ? high : low);
        pixels.push_back(big_endian ? low : high);
      }
      pixels.resize(pixels.size() + 6);  // padding behind each row
    }
    const ImageMessage image{.stamp = HostTime{std::chrono::seconds(50 + i)},
                             .frame_id = "front",
                             .width = kWidth,
                             .height = kHeight,
                             .encoding = "16UC1",
                             .is_big_endian = big_endian,
                             .step = kWidth * 2 + 6,
                             .data = pixels};
    body.clear();
    encode_image_header(image, body);
    writer.add_message({.channel_id = image_topic, .sequence = i, .log_time = i, .data = {}},
                       {body.bytes(), pixels});
  }
  EXPECT_TRUE(writer.finish().has_value());
  return {sink.bytes().begin(), sink.bytes().end()};
}

TEST(ForeignRecording, IsReadByItsTopics) {
  for (const bool big_endian : {false, true}) {
    const auto bytes = foreign_recording(true, big_endian);
    auto reader = RecordingReader::open(bytes, DamagePolicy::kStop);
    ASSERT_TRUE(reader.has_value()) << reader.error().message;
    EXPECT_FALSE((*reader)->has_blob());
    ASSERT_EQ((*reader)->rig().sensors.size(), 1U);
    EXPECT_EQ((*reader)->rig().sensors[0].name.view(), "front_depth");
    EXPECT_FALSE((*reader)->rig().sensors[0].has_pose);
    EXPECT_EQ((*reader)->start(), HostTime{std::chrono::seconds(50)});
    OwnedSlot owned;
    for (std::uint32_t i = 0; i < 3; ++i) {
      ASSERT_TRUE(*(*reader)->next(owned.slot));
      EXPECT_EQ(owned.slot.instant, HostTime{std::chrono::seconds(50 + i)});
      EXPECT_EQ(owned.slot.depth().at(5, 7), 1000 + i * 100 + 5) << "big-endian: " << big_endian;
    }
  }
}

TEST(ForeignRecording, WithoutItsCameraIsRefused) {
  const auto bytes = foreign_recording(false, false);
  const auto reader = RecordingReader::open(bytes, DamagePolicy::kStop);
  ASSERT_FALSE(reader.has_value());
  EXPECT_THAT(reader.error().message, HasSubstr("no depth images with a camera"));
}

}  // namespace
}  // namespace wagonsight
