// What others see of our recordings: the reference MCAP reader (@mcap/core) and a public CDR reader
// (@foxglove/rosmsg2-serialization) from npm, at the versions of package-lock.json. Skipped where
// node or the packages are not there.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "synthetic_recording.h"

namespace wagonsight {
namespace {

using namespace wagonsight::testing;  // NOLINT: the helpers of the recording tests
using nlohmann::json;
namespace fs = std::filesystem;

constexpr std::uint32_t kFrames = 24;

bool succeeds(const std::string& command) {
  return std::system(command.c_str()) == 0;  // NOLINT: a test's own command
}

std::string output_of(const std::string& command) {
  std::FILE* pipe = ::popen(command.c_str(), "r");  // NOLINT: a test's own command
  if (pipe == nullptr) return {};
  std::string text;
  std::array<char, 4096> part{};
  for (std::size_t got = 0; (got = std::fread(part.data(), 1, part.size(), pipe)) > 0;)
    text.append(part.data(), got);
  return ::pclose(pipe) == 0 ? text : std::string();
}

void write(const fs::path& path, std::span<const std::byte> bytes) {
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
}

std::uint32_t hash_of(std::span<const std::byte> bytes) {  // FNV-1a, as in check_recording.mjs
  std::uint32_t hash = 0x811c9dc5U;
  for (const std::byte byte : bytes) hash = (hash ^ std::to_integer<unsigned>(byte)) * 0x01000193U;
  return hash;
}

class RecordingReference : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (!succeeds("node --version > /dev/null 2>&1"))
      why_not_ = "node is not installed";
    else if (!fs::exists(node_modules() / "@mcap/core"))
      why_not_ = "its npm packages are not there; ./scripts/lib/npm-ci installs them";
  }

  void SetUp() override {
    if (!why_not_.empty()) GTEST_SKIP() << "recordings are not checked by others: " << why_not_;
  }

  static json read_with_reference(std::span<const std::byte> recording) {
    // Tests of this program run side by side, each as a process of its own.
    const fs::path folder(WAGONSIGHT_CHECK_BINARY);
    fs::create_directories(folder);
    const std::string name = ::testing::UnitTest::GetInstance()->current_test_info()->name();
    const fs::path path = folder / (name + ".mcap");
    write(path, recording);
    const std::string text =
        output_of(fmt::format("node '{}/check_recording.mjs' '{}' '{}'", WAGONSIGHT_CHECK_SOURCE,
                              path.string(), node_modules().string()));
    return json::parse(text, nullptr, false);
  }

  static fs::path node_modules() { return fs::path(WAGONSIGHT_CHECK_SOURCE) / "node_modules"; }

  static std::string why_not_;
};
std::string RecordingReference::why_not_;

HostTime time_of(const json& stamp) {
  return HostTime{std::chrono::seconds(stamp.at("sec").get<std::int64_t>()) +
                  std::chrono::nanoseconds(stamp.at("nanosec").get<std::int64_t>())};
}

McapWriterOptions small_chunks() {
  McapWriterOptions options;
  options.chunk_bytes = 4096;
  return options;
}

TEST_F(RecordingReference, SeesEveryFrameAsItWas) {
  const json seen = read_with_reference(record(kFrames, small_chunks()));
  ASSERT_TRUE(seen.is_object()) << "the reference reader refused the recording";
  EXPECT_EQ(seen.at("profile"), "ros2");
  std::map<std::string, std::vector<json>> by_topic;
  for (const json& message : seen.at("messages")) by_topic[message.at("topic")].push_back(message);
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    OwnedSlot wanted;
    fill_frame(i, wanted);
    const FrameSlot& slot = wanted.slot;
    const bool is_depth = i % 2 == 0;
    const std::string sensor = is_depth ? "/k0" : "/s_0";
    const json& info = by_topic.at(sensor + "/frame_info").at(i / 2).at("message");
    EXPECT_EQ(time_of(info.at("header").at("stamp")), slot.instant);
    EXPECT_EQ(time_of(info.at("arrival")), slot.arrival);
    EXPECT_EQ(info.at("device_ticks"), std::to_string(slot.device_ticks));
    EXPECT_EQ(info.at("sequence"), slot.sequence);
    EXPECT_EQ(info.at("damaged"), slot.damaged);
    for (const int half : is_depth ? std::vector{0} : std::vector{0, 1}) {
      const std::string stream = is_depth ? "/depth" : half == 0 ? "/left" : "/right";
      const json& sent = by_topic.at(sensor + stream + "/image_raw").at(i / 2);
      const json& image = sent.at("message");
      EXPECT_EQ(time_of(image.at("header").at("stamp")), slot.instant);
      EXPECT_EQ(image.at("encoding"), is_depth ? "16UC1" : "mono8");
      EXPECT_EQ(image.at("width"), kWidth);
      EXPECT_EQ(image.at("height"), kHeight);
      EXPECT_EQ(image.at("step"), is_depth ? kWidth * 2 : kWidth);
      EXPECT_EQ(image.at("is_bigendian"), 0);
      const auto pixels =
          std::span<const std::byte>(wanted.memory)
              .subspan(static_cast<std::size_t>(half) * slot.image_bytes(), slot.image_bytes());
      EXPECT_EQ(image.at("data").at("hash"), hash_of(pixels)) << "frame " << i;
      const json& camera = by_topic.at(sensor + stream + "/camera_info").at(i / 2).at("message");
      EXPECT_EQ(camera.at("distortion_model"), "plumb_bob");
      EXPECT_EQ(camera.at("k").at(0), is_depth ? 30 : 40);
      EXPECT_EQ(camera.at("d").at(4), is_depth ? 0.003 : 0);
      EXPECT_EQ(camera.at("p").at(3), half == 1 ? -40 * 0.24 : 0);
    }
  }
}

TEST_F(RecordingReference, FindsIndexSumsAndAttachmentsRight) {
  const auto bytes = record(kFrames, small_chunks());
  const json seen = read_with_reference(bytes);
  ASSERT_TRUE(seen.is_object());
  const auto ours = McapReader::open(bytes);
  ASSERT_TRUE(ours.has_value());
  // 12 Kinect frames of three messages and 12 stereo frames of five.
  EXPECT_EQ(seen.at("statistics").at("messages"), "96");
  EXPECT_EQ(seen.at("statistics").at("indexedChunks"), ours->segments().size());
  EXPECT_EQ(seen.at("stream").at("whole"), true);
  EXPECT_EQ(seen.at("stream").at("left"), 0);
  EXPECT_EQ(seen.at("stream").at("counts").at("Message"), 96);
  EXPECT_EQ(seen.at("attachments").at(0).at("name"), "rig.blob");
  EXPECT_EQ(seen.at("metadata").at(0).at("values").at("source"), "test");
}

// The check itself must be able to fail.
TEST_F(RecordingReference, RefusesADamagedChunk) {
  auto bytes = record(kFrames, small_chunks());
  const auto chunk = McapReader::open(bytes)->segments().at(1);
  bytes[static_cast<std::size_t>(chunk.offset + chunk.length / 2)] ^= std::byte{1};
  EXPECT_TRUE(read_with_reference(bytes).is_discarded());
}

}  // namespace
}  // namespace wagonsight
