#include "slots/updater.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/sample_bundle.h"
#include "support/scratch_folder.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;

// A whole unit in a folder: slot a runs and is good, b holds something old.
class UpdaterTest : public ScratchFolder {
 protected:
  void SetUp() override {
    ScratchFolder::SetUp();
    put("facts/release", "version 1.0.0\narchitecture x86_64\nindex 5\n");
    put("facts/update.pub", key_text(public_key_of(sample_seed())));
    put("boot/loader/entries/a.conf", "title one\nsort-key wagonsight\nversion 2\n");
    put("boot/loader/entries/b+3.conf", "title one\nsort-key wagonsight\nversion 1\n");
    put("boot/a/vmlinuz", "kernel a");
    put("boot/b/vmlinuz", std::string(100'000, 'k'));
    put("root-a", std::string(300'000, 'a'));
    put("root-b", std::string(300'000, 'b'));
    put("data/identity/name", "wagon-1\n");
    put("data/unit/unit.toml", "first");
    places_ = {path("data"),   path("facts"), path("boot"), path("root-a"),
               path("root-b"), 'a',           "true"};
  }
  std::unique_ptr<Updater> updater() const {
    auto updater = Updater::open(places_);
    EXPECT_TRUE(updater) << updater.error().message;
    return std::move(*updater);
  }
  // Sends the file in blocks; the answer to the last one.
  static UpdaterReply send(Updater& updater, std::string_view file, std::size_t from = 0,
                           std::size_t until = ~std::size_t{0}) {
    UpdaterReply reply;
    for (std::size_t at = from; at < std::min(until, file.size()); at += 50'000) {
      reply =
          updater.call({UpdaterWish::kBlock, at, file.size()}, bytes_of(file.substr(at, 50'000)));
      if (reply.status != 202) break;
    }
    return reply;
  }
  static std::string state(Updater& updater) { return updater.call({}, {}).json; }
  bool running_slot_is_untouched() const {
    return get("root-a") == std::string(300'000, 'a') && get("boot/a/vmlinuz") == "kernel a" &&
           has("boot/loader/entries/a.conf");
  }

  UnitPlaces places_;
};

TEST_F(UpdaterTest, PutsABundleIntoTheOtherSlot) {
  const SampleBundle bundle = sample_update();
  const auto unit = updater();
  EXPECT_EQ(send(*unit, bundle.file()).status, 202);
  unit->wait();
  EXPECT_THAT(state(*unit), HasSubstr("\"state\":\"restart_needed\""));
  EXPECT_EQ(get("root-b").substr(0, 200'000), bundle.text("root"));
  EXPECT_EQ(get("boot/b/vmlinuz"), bundle.text("kernel"));  // which was longer before
  EXPECT_EQ(get("boot/b/initramfs"), bundle.text("initramfs"));
  EXPECT_THAT(get("boot/loader/entries/b+3.conf"),
              HasSubstr("version 3\nlinux /b/vmlinuz\ninitrd /b/initramfs\n"
                        "options console=ttyS0 roothash=12 slot=b"));
  EXPECT_TRUE(running_slot_is_untouched());
  EXPECT_FALSE(has("data/update/bundle"));
}

TEST_F(UpdaterTest, RaisesTheRollbackIndexOnlyWhenTheNewSlotIsGood) {
  {
    const auto unit = updater();
    send(*unit, sample_update().file());
    unit->wait();
    EXPECT_EQ(unit->unit().update_index(), 0U);
  }
  // The machine starts again, in b, which brings its own facts.
  places_.running = 'b';
  put("facts/release", "version 1.2.3\narchitecture x86_64\nindex 10\n");
  const auto unit = updater();
  EXPECT_EQ(unit->unit().update_index(), 0U);
  ASSERT_TRUE(unit->mark_good());
  EXPECT_EQ(unit->unit().update_index(), 10U);
  EXPECT_TRUE(has("boot/loader/entries/b.conf"));
  SampleBundle older = sample_update();
  older.manifest.index = 9;
  const UpdaterReply reply = send(*unit, older.file());
  EXPECT_EQ(reply.status, 422);
  EXPECT_THAT(reply.json, HasSubstr("older"));
}

TEST_F(UpdaterTest, TellsThatAnUpdateWasRolledBack) {
  put("data/update/installed", "slot b\nversion 1.2.3\nboot of another start\n");
  const auto unit = updater();
  EXPECT_THAT(state(*unit), HasSubstr("1.2.3 did not become ready and was rolled back"));
  EXPECT_THAT(state(*unit), HasSubstr("\"state\":\"nothing\""));
}

TEST_F(UpdaterTest, RefusesEachByItsName) {
  const std::string good = sample_update().file();
  const auto unit = updater();
  std::string flipped = good;
  flipped[good.size() - 100] ^= 1;
  SampleBundle other = sample_update();
  other.manifest.architecture = "aarch64";
  const std::pair<std::string, const char*> cases[] = {
      {flipped, "chunk 1 of 1 in part initramfs"},
      {sample_update().file(sample_seed(9)), "does not trust"},
      {good.substr(0, 200'000), "cut off"},
      {other.file(), "architecture aarch64"},
      {sample_provisioning("wagon-2", 1).file(), "unit wagon-2"}};
  for (const auto& [file, words] : cases) {
    const UpdaterReply reply = send(*unit, file);
    EXPECT_EQ(reply.status, 422) << words;
    EXPECT_THAT(reply.json, HasSubstr(words));
  }
  unit->wait();
  EXPECT_TRUE(running_slot_is_untouched());
  EXPECT_EQ(get("root-b"), std::string(300'000, 'b'));
  EXPECT_TRUE(has("boot/loader/entries/b+3.conf"));
}

TEST_F(UpdaterTest, WithoutAKeyTakesNothing) {
  std::filesystem::remove(path("facts/update.pub"));
  const auto unit = updater();
  EXPECT_THAT(send(*unit, sample_update().file()).json, HasSubstr("without a public key"));
  EXPECT_THAT(state(*unit), HasSubstr("\"takes_bundles\":false"));
}

TEST_F(UpdaterTest, KeepsTheOnlySlotThatIsProved) {
  std::filesystem::rename(path("boot/loader/entries/a.conf"),
                          path("boot/loader/entries/a+2-1.conf"));
  const auto unit = updater();
  send(*unit, sample_update().file());
  unit->wait();
  EXPECT_THAT(state(*unit), HasSubstr("has not proved itself"));
  EXPECT_EQ(get("root-b"), std::string(300'000, 'b'));
  EXPECT_TRUE(has("boot/loader/entries/b+3.conf"));
}

TEST_F(UpdaterTest, KnowsWhetherThereIsABetterSlotToGoTo) {
  EXPECT_FALSE(*updater()->is_on_trial());
  places_.running = 'b';
  EXPECT_TRUE(*updater()->is_on_trial());
  // As flashed: both are unproved, and going to the other one helps nobody.
  std::filesystem::rename(path("boot/loader/entries/a.conf"), path("boot/loader/entries/a+3.conf"));
  EXPECT_FALSE(*updater()->is_on_trial());
}

TEST_F(UpdaterTest, RefusesARootThatDoesNotFit) {
  put("root-b", std::string(1000, 'b'));
  const auto unit = updater();
  send(*unit, sample_update().file());
  unit->wait();
  EXPECT_THAT(state(*unit), HasSubstr("has room for 1000"));
  EXPECT_FALSE(has("boot/loader/entries/b+3.conf"));
  EXPECT_TRUE(running_slot_is_untouched());
}

TEST_F(UpdaterTest, GoesOnWithAnUploadAfterAPowerCut) {
  const std::string file = sample_update().file();
  {
    const auto unit = updater();
    send(*unit, file, 0, 150'000);
  }
  const auto unit = updater();
  EXPECT_THAT(state(*unit), HasSubstr("\"state\":\"receiving\""));
  EXPECT_THAT(state(*unit), HasSubstr("\"received_bytes\":150000"));
  EXPECT_THAT(
      state(*unit),
      HasSubstr(hex_text(std::span(reinterpret_cast<const std::uint8_t*>(file.data()) + 24, 64))));
  EXPECT_EQ(send(*unit, file, 200'000).status, 409);
  EXPECT_EQ(send(*unit, file, 150'000).status, 202);
  unit->wait();
  EXPECT_THAT(state(*unit), HasSubstr("restart_needed"));
}

TEST_F(UpdaterTest, InstallsAfterAPowerCutWhatHadCome) {
  put("data/update/bundle", sample_update().file());
  const auto unit = updater();
  unit->resume();
  unit->wait();
  EXPECT_THAT(state(*unit), HasSubstr("restart_needed"));
  EXPECT_EQ(get("root-b").substr(0, 200'000), sample_update().text("root"));
}

TEST_F(UpdaterTest, StopsWhenWhatLiesOnTheDiskHasDecayed) {
  std::string file = sample_update().file();
  file[file.size() / 2] ^= 1;
  put("data/update/bundle", file);
  const auto unit = updater();
  unit->resume();
  unit->wait();
  EXPECT_THAT(state(*unit), HasSubstr("is damaged"));
  EXPECT_EQ(get("root-b"), std::string(300'000, 'b'));
}

TEST_F(UpdaterTest, TakesProvisioningForThisUnit) {
  const auto unit = updater();
  EXPECT_EQ(send(*unit, sample_provisioning("wagon-1", 1).file()).status, 202);
  unit->wait();
  EXPECT_THAT(state(*unit), HasSubstr("restart_needed"));
  // The same once more is a replay.
  EXPECT_THAT(send(*unit, sample_provisioning("wagon-1", 1).file()).json, HasSubstr("already"));
  ASSERT_TRUE(unit->unit().settle());
  EXPECT_THAT(get("data/unit/unit.toml"), HasSubstr("new"));
}

TEST_F(UpdaterTest, SaysWhatTheDaemonSaysOfTheSettings) {
  put("daemon", "#!/bin/sh\necho 'unit.toml:3: \"leaf\": no such key' >&2\nexit 1\n");
  std::filesystem::permissions(path("daemon"), std::filesystem::perms::all);
  places_.daemon = path("daemon");
  const auto unit = updater();
  send(*unit, sample_provisioning("wagon-1", 1).file());
  unit->wait();
  EXPECT_THAT(state(*unit), HasSubstr("Unit.toml:3: \\\"leaf\\\": no such key"));
  EXPECT_EQ(get("data/unit/unit.toml"), "first");
}

TEST_F(UpdaterTest, RestartsAndResetsWhenAsked) {
  const auto unit = updater();
  const UpdaterReply reset = unit->call({UpdaterWish::kFactoryReset, 0, 0}, {});
  EXPECT_EQ(reset.status, 202);
  EXPECT_FALSE(reset.restart);
  EXPECT_THAT(state(*unit), HasSubstr("restart_needed"));
  EXPECT_TRUE(unit->call({UpdaterWish::kRestart, 0, 0}, {}).restart);
}

TEST_F(UpdaterTest, ForgetsAnUpload) {
  const auto unit = updater();
  send(*unit, sample_update().file(), 0, 100'000);
  EXPECT_EQ(unit->call({UpdaterWish::kDiscard, 0, 0}, {}).status, 202);
  EXPECT_THAT(state(*unit), HasSubstr("\"state\":\"nothing\""));
  EXPECT_FALSE(has("data/update/incoming"));
}

}  // namespace
}  // namespace wagonsight
