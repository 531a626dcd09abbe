// The recorder of the depot with frames of a small rig, on disks that keep up, are slow, full, or
// lose their power.
#include "depot_recorder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <condition_variable>
#include <map>
#include <random>
#include <set>

#include "linux/clocks.h"
#include "unit/recording/synthetic_recording.h"

namespace wagonsight {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;
using namespace wagonsight::testing;  // NOLINT: the helpers of the recording's tests

// A disk in memory that can be stopped, filled, and asked what a power cut would have left.
class TestDisk final : public RecordingDisk {
 public:
  struct Moment {  // what the file was after a call
    HostTime time{};
    std::string path;
    std::size_t size = 0, synced = 0;
  };

  Result<void> make_folder(const std::string&) override { return {}; }
  bool exists(const std::string& path) override {
    const std::lock_guard hold(mutex_);
    return files.count(path) != 0;
  }
  Result<std::uint64_t> free_bytes(const std::string&) override { return free.load(); }
  Result<std::unique_ptr<RecordingFile>> create(const std::string& path) override {
    const std::lock_guard hold(mutex_);
    EXPECT_EQ(files.count(path), 0U);
    files[path];
    return std::make_unique<File>(*this, path);
  }

  void hold_up() {
    const std::lock_guard hold(mutex_);
    is_held_up_ = true;
  }
  void go_on() {
    const std::lock_guard hold(mutex_);
    is_held_up_ = false;
    changed_.notify_all();
  }

  std::map<std::string, std::vector<std::byte>> files;  // by path; of a recorder at rest
  std::vector<Moment> moments;
  std::atomic<std::uint64_t> free{std::uint64_t{1} << 40U};
  std::atomic<std::int64_t> room{std::int64_t{1} << 40U};  // until appending fails

 private:
  class File final : public RecordingFile {
   public:
    File(TestDisk& disk, std::string path) : disk_(disk), path_(std::move(path)) {}
    Result<void> append(std::span<const std::byte> bytes) override {
      std::unique_lock lock(disk_.mutex_);
      disk_.changed_.wait(lock, [&] { return !disk_.is_held_up_; });
      auto& content = disk_.files[path_];
      const auto room = static_cast<std::size_t>(std::max<std::int64_t>(disk_.room, 0));
      const auto part = bytes.first(std::min(bytes.size(), room));
      content.insert(content.end(), part.begin(), part.end());
      disk_.room -= static_cast<std::int64_t>(part.size());
      note(content.size());
      if (part.size() < bytes.size()) return fail(path_ + ": No space left on device");
      return {};
    }
    Result<void> sync() override {
      const std::lock_guard hold(disk_.mutex_);
      synced_ = disk_.files[path_].size();
      note(synced_);
      return {};
    }
    Result<void> cut_to(std::uint64_t size) override {
      const std::lock_guard hold(disk_.mutex_);
      disk_.files[path_].resize(static_cast<std::size_t>(size));
      return {};
    }

   private:
    void note(std::size_t size) { disk_.moments.push_back({host_now(), path_, size, synced_}); }
    TestDisk& disk_;
    std::string path_;
    std::size_t synced_ = 0;
  };

  std::mutex mutex_;
  std::condition_variable changed_;
  bool is_held_up_ = false;
};

constexpr std::size_t kSlotBytes = std::size_t{kWidth} * kHeight * 4;

DepotOptions options_for_tests() {
  DepotOptions options;
  options.folder = "depot";
  options.memory_bytes = 16 * kSlotBytes;
  return options;
}

void offer(DepotRecorder& recorder, std::uint32_t i, bool at_real_time = false) {
  OwnedSlot owned;
  fill_frame(i, owned);
  if (at_real_time) owned.slot.arrival = owned.slot.instant = host_now();
  recorder.offer(owned.slot);
}

template <class Condition>
bool comes_true(Condition condition) {
  for (int i = 0; i < 12'000; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(milliseconds(5));
  }
  return false;
}
bool comes_to_rest(const DepotRecorder& recorder) {
  return comes_true([&] { return recorder.status().state == RecordingState::kOff; });
}

struct Read {
  bool is_complete = false;
  std::vector<std::uint32_t> numbers;
  HostTime last{};
};
Read read_back(std::span<const std::byte> bytes, bool checks_pixels = true) {
  Read read;
  auto reader = RecordingReader::open(bytes, DamagePolicy::kStop);
  if (!reader) {
    ADD_FAILURE() << reader.error().message;
    return read;
  }
  EXPECT_TRUE((*reader)->has_blob());
  read.is_complete = (*reader)->mcap().complete();
  OwnedSlot owned;
  while (true) {
    const auto more = (*reader)->next(owned.slot);
    EXPECT_TRUE(more.has_value()) << more.error().message;
    if (!more || !*more) return read;
    read.numbers.push_back(owned.slot.sequence - 1000);
    read.last = std::max(read.last, owned.slot.arrival);
    if (checks_pixels) expect_frame(read.numbers.back(), owned);
  }
}

// All frames of all files; each in one only.
std::set<std::uint32_t> all_frames(const TestDisk& disk) {
  std::set<std::uint32_t> all;
  for (const auto& [path, bytes] : disk.files)
    for (const std::uint32_t number : read_back(bytes).numbers)
      EXPECT_TRUE(all.insert(number).second) << path << " repeats frame " << number;
  return all;
}

TEST(DepotRecorder, WritesEveryFrameOfEverySensor) {
  TestDisk disk;
  DepotRecorder recorder(small_rig(), kSlotBytes, options_for_tests(), disk);
  offer(recorder, 900);  // nothing is on yet
  ASSERT_TRUE(recorder.start(std::chrono::minutes(5)).has_value());
  EXPECT_EQ(recorder.status().state, RecordingState::kOn);
  for (std::uint32_t i = 0; i < 200; ++i) {
    offer(recorder, i);
    if (i % 8 == 7) std::this_thread::sleep_for(milliseconds(25));
  }
  recorder.stop();
  ASSERT_TRUE(comes_to_rest(recorder));
  offer(recorder, 901);
  const RecordingStatus status = recorder.status();
  EXPECT_EQ(status.frames + status.dropped, 200U);
  EXPECT_EQ(status.files, 1U);
  ASSERT_EQ(disk.files.size(), 1U);
  EXPECT_EQ(status.bytes, disk.files.begin()->second.size());
  const Read read = read_back(disk.files.begin()->second);
  EXPECT_TRUE(read.is_complete);
  EXPECT_EQ(read.numbers.size(), status.frames);
  EXPECT_TRUE(std::is_sorted(read.numbers.begin(), read.numbers.end()));
}

TEST(DepotRecorder, DropsTheOldestWhileTheDiskStandsStillAndNeverWaits) {
  TestDisk disk;
  DepotRecorder recorder(small_rig(), kSlotBytes, options_for_tests(), disk);
  disk.hold_up();
  ASSERT_TRUE(recorder.start(std::chrono::minutes(5)).has_value());
  // The disk stands still all the while, so this would hang if anything waited for it.
  for (std::uint32_t i = 0; i < 300; ++i) offer(recorder, i);
  const RecordingStatus stuck = recorder.status();
  EXPECT_GE(stuck.dropped, 300U - 16U);
  EXPECT_EQ(stuck.frames, 0U);
  disk.go_on();
  recorder.stop();
  ASSERT_TRUE(comes_to_rest(recorder));
  const std::set<std::uint32_t> kept = all_frames(disk);
  const RecordingStatus status = recorder.status();
  EXPECT_EQ(kept.size(), status.frames);
  EXPECT_EQ(status.frames + status.dropped, 300U);
  for (std::uint32_t i = 290; i < 300; ++i)
    EXPECT_EQ(kept.count(i), 1U) << "the newest stay: " << i;
}

TEST(DepotRecorder, GoesOnInANewFileWhenAFullDiskHasRoomAgain) {
  TestDisk disk;
  DepotOptions options = options_for_tests();
  DepotRecorder recorder(small_rig(), kSlotBytes, options, disk);
  disk.room = 90'000;
  ASSERT_TRUE(recorder.start(std::chrono::minutes(5)).has_value());
  std::uint32_t offered = 0;
  ASSERT_TRUE(comes_true([&] {
    offer(recorder, offered++);
    return recorder.status().state == RecordingState::kNoDisk;
  }));
  EXPECT_THAT(std::string(recorder.status().trouble.view()), HasSubstr("No space left"));
  disk.room = std::int64_t{1} << 40U;
  ASSERT_TRUE(comes_true([&] {
    offer(recorder, offered++);
    return recorder.status().state == RecordingState::kOn;
  }));
  EXPECT_TRUE(recorder.status().trouble.empty());
  recorder.stop();
  ASSERT_TRUE(comes_to_rest(recorder));
  const RecordingStatus status = recorder.status();
  EXPECT_EQ(status.frames + status.dropped, offered);
  ASSERT_EQ(disk.files.size(), 2U);
  EXPECT_FALSE(read_back(disk.files.begin()->second).is_complete);
  EXPECT_TRUE(read_back(disk.files.rbegin()->second).is_complete);
  EXPECT_EQ(all_frames(disk).size(), status.frames);
}

TEST(DepotRecorder, EndsBeforeTheDiskIsFull) {
  TestDisk disk;
  DepotRecorder recorder(small_rig(), kSlotBytes, options_for_tests(), disk);
  ASSERT_TRUE(recorder.start(std::chrono::minutes(5)).has_value());
  for (std::uint32_t i = 0; i < 10; ++i) offer(recorder, i);
  ASSERT_TRUE(comes_true([&] { return recorder.status().frames == 10; }));
  disk.free = 1000;
  ASSERT_TRUE(comes_to_rest(recorder));
  EXPECT_THAT(std::string(recorder.status().trouble.view()), HasSubstr("1024 MB are free"));
  EXPECT_EQ(all_frames(disk).size(), 10U);
  // And begins nothing while there is no room.
  ASSERT_TRUE(comes_true([&] { return recorder.start(std::chrono::minutes(5)).has_value(); }));
  offer(recorder, 10);
  ASSERT_TRUE(comes_to_rest(recorder));
  EXPECT_EQ(disk.files.size(), 1U);
  EXPECT_EQ(recorder.status().dropped, 1U);
}

TEST(DepotRecorder, EndsByItselfAndCanBeStartedAgain) {
  TestDisk disk;
  DepotRecorder recorder(small_rig(), kSlotBytes, options_for_tests(), disk);
  for (std::uint32_t turn = 0; turn < 2; ++turn) {
    // The last one's thread is gone a moment after it has said that it ended.
    ASSERT_TRUE(comes_true([&] { return recorder.start(milliseconds(60)).has_value(); }));
    offer(recorder, turn);
    ASSERT_TRUE(comes_to_rest(recorder));
    EXPECT_TRUE(recorder.status().trouble.empty());
    EXPECT_EQ(disk.files.size(), turn + 1);
  }
  EXPECT_EQ(all_frames(disk).size(), 2U);
}

TEST(DepotRecorder, BeginsANewFileInTime) {
  TestDisk disk;
  DepotOptions options = options_for_tests();
  options.file_length = milliseconds(500);  // fifteen frames
  options.memory_bytes = 64 * kSlotBytes;   // a writer that comes late loses none of them
  DepotRecorder recorder(small_rig(), kSlotBytes, options, disk);
  ASSERT_TRUE(recorder.start(std::chrono::minutes(5)).has_value());
  for (std::uint32_t i = 0; i < 60; ++i) {
    offer(recorder, i);
    if (i % 8 == 7) {
      ASSERT_TRUE(comes_true([&] { return recorder.status().files >= i / 16; }));
    }
    std::this_thread::sleep_for(milliseconds(2));
  }
  recorder.stop();
  ASSERT_TRUE(comes_to_rest(recorder));
  EXPECT_EQ(disk.files.size(), 4U);
  for (const auto& [path, bytes] : disk.files) EXPECT_TRUE(read_back(bytes).is_complete) << path;
  EXPECT_EQ(all_frames(disk).size(), 60U);
}

// Each file says how things stand when it begins.
TEST(DepotRecorder, WritesWhatTheTrainSaysIntoEachFile) {
  TestDisk disk;
  DepotOptions options = options_for_tests();
  options.has_vehicle = true;
  options.file_length = milliseconds(500);
  DepotRecorder recorder(small_rig(), kSlotBytes, options, disk);
  recorder.tell_vehicle({HostTime{}, true, 12.5, false, "", {{"left", 1}}});
  ASSERT_TRUE(recorder.start(std::chrono::minutes(5)).has_value());
  for (std::uint32_t i = 0; i < 30; ++i) {
    offer(recorder, i);
    std::this_thread::sleep_for(milliseconds(5));
  }
  ASSERT_TRUE(comes_true([&] { return recorder.status().files == 2; }));
  recorder.tell_vehicle({HostTime{Duration{1}}, true, 0, true, "Thun", {{"left", 2}}});
  recorder.stop();
  ASSERT_TRUE(comes_to_rest(recorder));
  std::vector<std::string> said;
  for (const auto& [path, bytes] : disk.files) {
    const auto mcap = McapReader::open(bytes);
    ASSERT_TRUE(mcap.has_value());
    McapCursor cursor(*mcap, DamagePolicy::kStop);
    McapMessage message;
    for (auto more = cursor.next(message); more && *more; more = cursor.next(message)) {
      const auto& channels = mcap->channels();
      const auto channel = std::find_if(channels.begin(), channels.end(), [&](const auto& known) {
        return known.id == message.channel_id;
      });
      if (channel->topic != "/vehicle/state") continue;
      const auto state = decode_vehicle_state(message.data);
      ASSERT_TRUE(state.has_value());
      said.push_back(state->stop + std::to_string(state->doors.at(0).state));
    }
  }
  EXPECT_THAT(said, ::testing::ElementsAre("1", "1", "Thun2"));
}

// What was not synced may be there, in part, or not.
TEST(DepotRecorder, LosesAtMostTheLastSecondToAPowerCut) {
  TestDisk disk;
  DepotRecorder recorder(small_rig(), kSlotBytes, options_for_tests(), disk);
  ASSERT_TRUE(recorder.start(std::chrono::minutes(5)).has_value());
  const HostTime begin = host_now();
  for (std::uint32_t i = 0; i < 220; ++i) {
    offer(recorder, i, true);
    std::this_thread::sleep_for(milliseconds(12));
  }
  const HostTime end = host_now();
  recorder.stop();
  ASSERT_TRUE(comes_to_rest(recorder));
  if (recorder.status().dropped > 0) GTEST_SKIP() << "this machine was too busy to write at all";
  ASSERT_EQ(disk.files.size(), 1U);
  const auto& content = disk.files.begin()->second;
  std::mt19937_64 random(5);
  for (int cut = 0; cut < 40; ++cut) {
    const auto at = begin + Duration(std::uniform_int_distribution<std::int64_t>(
                                1'200'000'000, (end - begin).count())(random));
    TestDisk::Moment last;
    for (const TestDisk::Moment& moment : disk.moments)
      if (moment.time <= at) last = moment;
    const std::size_t left =
        std::uniform_int_distribution<std::size_t>(last.synced, last.size)(random);
    const Read read = read_back(std::span(content).first(left), false);
    EXPECT_LE(to_seconds(at - read.last), 1.0) << "cut after " << to_seconds(at - begin) << " s";
  }
}

}  // namespace
}  // namespace wagonsight
