#include "slots/slot_install.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cstring>
#include <map>

#include "support/sample_bundle.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;

// A slot on a disk that may lose its power at every write: what was not synced by then has arrived
// wholly, in part, or not at all, each write for itself.
class MemorySlot final : public Slot {
 public:
  struct Disk {
    std::map<std::string, std::string> parts;
    bool is_listed = false;
    std::string version;
  };

  explicit MemorySlot(Disk& disk) : disk_(disk) {}

  int writes_left = 1 << 30;  // until the power fails
  bool decays = false;        // the disk does not give back what was written

  Result<void> prepare(const BundlePart&) override { return {}; }
  Result<bool> read(std::string_view part, std::uint64_t offset,
                    std::span<std::byte> bytes) override {
    const std::string& stored = (pending_.empty() ? disk_.parts : now_)[std::string(part)];
    if (stored.size() < offset + bytes.size()) return false;
    std::memcpy(bytes.data(), stored.data() + offset, bytes.size());
    return true;
  }
  Result<void> write(std::string_view part, std::uint64_t offset,
                     std::span<const std::byte> bytes) override {
    if (pending_.empty()) now_ = disk_.parts;
    pending_.push_back({std::string(part), offset,
                        std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size())});
    put(now_, pending_.back(), bytes.size());
    return power();
  }
  Result<void> sync() override {
    if (auto on = power(); !on) return on;
    if (!pending_.empty()) disk_.parts = now_;
    if (decays) disk_.parts["root"][5] ^= 1;
    pending_.clear();
    return {};
  }
  Result<void> unlist() override {
    if (auto on = power(); !on) return on;
    disk_.is_listed = false;
    return {};
  }
  Result<void> list(std::string_view version, std::string_view) override {
    if (auto on = power(); !on) return on;
    disk_.is_listed = true;
    disk_.version = version;
    return {};
  }
  // What is on the disk after the power failed: `share` of each waiting write, in thousandths.
  void cut(const std::vector<int>& shares) {
    for (std::size_t i = 0; i < pending_.size(); ++i)
      put(disk_.parts, pending_[i],
          pending_[i].bytes.size() * static_cast<std::size_t>(shares[i % shares.size()]) / 1000);
  }

 private:
  struct Write {
    std::string part;
    std::uint64_t offset;
    std::string bytes;
  };
  static void put(std::map<std::string, std::string>& parts, const Write& write, std::size_t size) {
    std::string& content = parts[write.part];
    if (content.size() < write.offset + size) content.resize(write.offset + size, '?');
    content.replace(write.offset, size, write.bytes, 0, size);
  }
  Result<void> power() {
    if (writes_left-- > 0) return {};
    return fail("the power failed");
  }

  Disk& disk_;
  std::map<std::string, std::string> now_;
  std::vector<Write> pending_;
};

PartSource source_of(const SampleBundle& bundle) {
  return [&bundle](const BundlePart& part, std::uint64_t offset,
                   std::span<std::byte> bytes) -> Result<void> {
    std::memcpy(bytes.data(), bundle.text(part.name).data() + offset, bytes.size());
    return {};
  };
}

bool is_whole(const MemorySlot::Disk& disk, const SampleBundle& bundle) {
  for (const auto& [name, text] : bundle.parts) {
    const auto found = disk.parts.find(name);
    if (found == disk.parts.end() || found->second.substr(0, text.size()) != text) return false;
  }
  return true;
}

MemorySlot::Disk old_disk() {
  const SampleBundle old = sample_update(150'000, 77);
  MemorySlot::Disk disk;
  for (const auto& [name, text] : old.parts) disk.parts[name] = text;
  disk.is_listed = true;
  disk.version = "old";
  return disk;
}

TEST(Install, WritesAllAndListsTheSlot) {
  const SampleBundle bundle = sample_update();
  MemorySlot::Disk disk = old_disk();
  MemorySlot slot(disk);
  std::uint64_t told = 0;
  const auto done = install(bundle.manifest, source_of(bundle), slot,
                            [&](const InstallProgress& now) { told = now.chunks_done; });
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_TRUE(disk.is_listed);
  EXPECT_EQ(disk.version, "1.2.3");
  EXPECT_TRUE(is_whole(disk, bundle));
  EXPECT_EQ(done->chunks, 7U);
  EXPECT_EQ(done->chunks_written, 7U);
  EXPECT_EQ(told, 7U);
}

TEST(Install, WritesOnlyWhatDiffers) {
  const SampleBundle bundle = sample_update();
  MemorySlot::Disk disk = old_disk();
  MemorySlot first(disk);
  ASSERT_TRUE(install(bundle.manifest, source_of(bundle), first));
  disk.parts["root"][70'000] ^= 1;
  MemorySlot second(disk);
  const auto done = install(bundle.manifest, source_of(bundle), second);
  ASSERT_TRUE(done);
  EXPECT_EQ(done->chunks_written, 1U);
  EXPECT_TRUE(is_whole(disk, bundle));
}

// The promise: wherever the power fails, the loader never has a slot that is not whole, and the
// next run finishes.
void cut_and_go_on(int writes, const std::vector<int>& shares) {
  const SampleBundle bundle = sample_update();
  MemorySlot::Disk disk = old_disk();
  MemorySlot slot(disk);
  slot.writes_left = writes;
  const bool was_cut = !install(bundle.manifest, source_of(bundle), slot).has_value();
  if (was_cut) slot.cut(shares);
  if (disk.is_listed && disk.version != "old") {
    ASSERT_TRUE(is_whole(disk, bundle)) << "after " << writes;
  }
  if (disk.is_listed && disk.version == "old") {
    ASSERT_EQ(disk.parts, old_disk().parts) << writes;
  }
  MemorySlot again(disk);
  const auto done = install(bundle.manifest, source_of(bundle), again);
  ASSERT_TRUE(done) << done.error().message;
  ASSERT_TRUE(disk.is_listed && disk.version == "1.2.3" && is_whole(disk, bundle));
}

TEST(Install, SurvivesAPowerCutAtEveryWrite) {
  for (int writes = 0; writes < 11; ++writes)
    for (const int share : {0, 500, 1000}) cut_and_go_on(writes, {share});
}

RC_GTEST_PROP(Install, SurvivesAPowerCutWithAnyOrderOfWrites, ()) {
  const auto writes = *rc::gen::inRange(0, 11);
  cut_and_go_on(writes, *rc::gen::container<std::vector<int>>(7, rc::gen::inRange(0, 1001)));
  RC_ASSERT(!::testing::Test::HasFatalFailure());
}

TEST(Install, GoesOnWhereItWas) {
  const SampleBundle bundle = sample_update();
  MemorySlot::Disk disk = old_disk();
  MemorySlot slot(disk);
  slot.writes_left = 5;  // the list, and four chunks
  ASSERT_FALSE(install(bundle.manifest, source_of(bundle), slot));
  slot.cut({1000});
  MemorySlot again(disk);
  const auto done = install(bundle.manifest, source_of(bundle), again);
  ASSERT_TRUE(done);
  EXPECT_EQ(done->chunks_written, 2U);
}

TEST(Install, ListsNoSlotWhoseDiskDoesNotGiveBackWhatWasWritten) {
  const SampleBundle bundle = sample_update();
  MemorySlot::Disk disk = old_disk();
  MemorySlot slot(disk);
  slot.decays = true;
  const auto done = install(bundle.manifest, source_of(bundle), slot);
  ASSERT_FALSE(done);
  EXPECT_THAT(done.error().message, HasSubstr("does not give back"));
  EXPECT_FALSE(disk.is_listed);
}

TEST(Install, WritesNothingOfABundleThatDecayedOnTheDisk) {
  const SampleBundle bundle = sample_update();
  MemorySlot::Disk disk = old_disk();
  MemorySlot slot(disk);
  const PartSource good = source_of(bundle);
  const auto done = install(
      bundle.manifest,
      [&](const BundlePart& part, std::uint64_t offset, std::span<std::byte> bytes) {
        auto given = good(part, offset, bytes);
        bytes[3] ^= std::byte{1};
        return given;
      },
      slot);
  ASSERT_FALSE(done);
  EXPECT_THAT(done.error().message, HasSubstr("chunk 1 of part root"));
  EXPECT_EQ(disk.parts["root"], old_disk().parts["root"]);
}

}  // namespace
}  // namespace wagonsight
