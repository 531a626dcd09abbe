#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <rapidcheck/gtest.h>
#include <string>
#include <vector>

#include "recording/mcap_reader.h"
#include "recording/mcap_writer.h"

namespace wagonsight {
namespace {

TEST(McapCrc32, MatchesThePublishedCheckValue) {
  const std::string_view text = "123456789";
  EXPECT_EQ(mcap_crc32(std::as_bytes(std::span(text.data(), text.size()))), 0xCBF43926U);
}

struct Sent {
  std::uint16_t channel = 0;
  std::uint64_t time = 0;
  std::string data;
};

std::vector<Sent> messages_of(const McapReader& reader) {
  std::vector<Sent> all;
  McapCursor cursor(reader, DamagePolicy::kStop);
  McapMessage message;
  while (*cursor.next(message))
    all.push_back(
        {message.channel_id, message.log_time,
         std::string(reinterpret_cast<const char*>(message.data.data()), message.data.size())});
  return all;
}

// Any messages of any size in any grouping come back in order, from the whole file and from the
// file without its summary, and the statistics tell their number.
RC_GTEST_PROP(Mcap, GivesBackWhatWasWritten, ()) {
  MemorySink sink;
  McapWriterOptions options;
  options.chunk_bytes = *rc::gen::inRange<std::size_t>(1, 3000);
  auto created = McapWriter::create(sink, options);
  RC_ASSERT(created.has_value());
  McapWriter& writer = **created;
  const auto schema = *writer.add_schema("a/msg/B", "ros2msg", "string text\n");
  const auto channels = *rc::gen::inRange<std::uint16_t>(1, 5);
  for (std::uint16_t i = 0; i < channels; ++i)
    (void)*writer.add_channel(schema, "/topic" + std::to_string(i), "cdr", {{"k", "v"}});
  std::vector<Sent> sent;
  const auto count = *rc::gen::inRange(0, 40);
  for (int i = 0; i < count; ++i) {
    Sent message{*rc::gen::inRange<std::uint16_t>(0, channels), static_cast<std::uint64_t>(i * 10),
                 *rc::gen::container<std::string>(rc::gen::arbitrary<char>())};
    const std::size_t half = message.data.size() / 2;
    const auto bytes = std::as_bytes(std::span(message.data.data(), message.data.size()));
    writer.add_message({.channel_id = message.channel, .log_time = message.time, .data = {}},
                       {bytes.first(half), bytes.subspan(half)});
    if (*rc::gen::arbitrary<bool>()) RC_ASSERT(writer.end_group().has_value());
    sent.push_back(std::move(message));
  }
  RC_ASSERT(writer.finish().has_value());

  const std::size_t tail = kMcapFooterBytes + kMcapMagic.size();
  for (const std::size_t cut : {std::size_t{0}, tail}) {
    const auto reader = McapReader::open(sink.bytes().first(sink.bytes().size() - cut));
    RC_ASSERT(reader.has_value());
    RC_ASSERT(reader->complete() == (cut == 0));
    RC_ASSERT(reader->channels().size() == channels);
    const auto got = messages_of(*reader);
    RC_ASSERT(got.size() == sent.size());
    for (std::size_t i = 0; i < got.size(); ++i) {
      RC_ASSERT(got[i].channel == sent[i].channel);
      RC_ASSERT(got[i].time == sent[i].time);
      RC_ASSERT(got[i].data == sent[i].data);
    }
  }
}

TEST(Mcap, KeepsAttachmentsAndMetadata) {
  MemorySink sink;
  auto writer = McapWriter::create(sink, {});
  ASSERT_TRUE(writer.has_value());
  const std::string data = "calibration";
  ASSERT_TRUE((*writer)
                  ->add_attachment({.name = "rig.blob",
                                    .media_type = "application/octet-stream",
                                    .log_time = 5,
                                    .create_time = 4,
                                    .data = std::as_bytes(std::span(data.data(), data.size()))})
                  .has_value());
  ASSERT_TRUE((*writer)->add_metadata({"origin", {{"seed", "17"}, {"scene", "walk"}}}).has_value());
  ASSERT_TRUE((*writer)->finish().has_value());
  for (const std::size_t cut : {std::size_t{0}, std::size_t{1}}) {
    const auto reader = McapReader::open(sink.bytes().first(sink.bytes().size() - cut));
    ASSERT_TRUE(reader.has_value());
    EXPECT_EQ(reader->metadata_value("origin", "scene"), "walk");
    const auto found = reader->find_attachment("rig.blob");
    ASSERT_TRUE(found.has_value() && found->has_value());
    EXPECT_EQ((*found)->log_time, 5U);
    EXPECT_EQ((*found)->data.size(), data.size());
    EXPECT_FALSE(reader->find_attachment("other")->has_value());
  }
}

TEST(Mcap, RefusesAChunkThatClaimsTooMuch) {
  MemorySink sink;
  auto writer = McapWriter::create(sink, {});
  const auto schema = *(*writer)->add_schema("a/msg/B", "ros2msg", "");
  const auto channel = *(*writer)->add_channel(schema, "/t", "cdr", {});
  (*writer)->add_message({.channel_id = channel, .data = {}}, {});
  ASSERT_TRUE((*writer)->finish().has_value());
  std::vector<std::byte> bytes(sink.bytes().begin(), sink.bytes().end());
  const auto chunk = McapReader::open(bytes)->segments().at(0).offset;
  bytes[static_cast<std::size_t>(chunk) + kMcapRecordHeaderBytes + 16 + 5] = std::byte{0x7F};
  const auto reader = McapReader::open(bytes);
  ASSERT_TRUE(reader.has_value());
  McapCursor cursor(*reader, DamagePolicy::kStop);
  McapMessage message;
  const auto more = cursor.next(message);
  ASSERT_FALSE(more.has_value());
  EXPECT_THAT(more.error().message, ::testing::HasSubstr("claims"));
}

}  // namespace
}  // namespace wagonsight
