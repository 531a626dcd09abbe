#include "slots/provisioning.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>

#include "support/sample_bundle.h"
#include "support/scratch_folder.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;

class Provisioning : public ScratchFolder {
 protected:
  // Settings that say "bad" are in no order.
  UnitData unit() const {
    return UnitData(path("data"), [](const std::string& folder) -> Result<void> {
      std::ifstream file(folder + "/unit.toml");
      const std::string text{std::istreambuf_iterator<char>(file), {}};
      if (text.find("bad") != std::string::npos) return fail("unit.toml:1: bad");
      return {};
    });
  }
  void put_stick() const {
    put("stick/unit.toml", "first");
    put("stick/rig.blob", "calibration");
    put("stick/name", "wagon-1\n");
  }
  static std::string refusal(const Result<void>& done) {
    return done ? std::string() : done.error().message;
  }
  static Result<void> take_bundle(UnitData& unit, const SampleBundle& bundle) {
    return unit.take_bundle(bundle.manifest,
                            [&](const BundlePart& part, std::uint64_t offset,
                                std::span<std::byte> bytes) -> Result<void> {
                              std::memcpy(bytes.data(), bundle.text(part.name).data() + offset,
                                          bytes.size());
                              return {};
                            });
  }
};

TEST_F(Provisioning, TakesAFolderOnce) {
  put_stick();
  UnitData data = unit();
  EXPECT_FALSE(data.is_provisioned());
  EXPECT_EQ(refusal(data.take_folder(path("stick"), "drawn")), "");
  EXPECT_TRUE(data.is_provisioned());
  EXPECT_EQ(data.name(), "wagon-1");
  EXPECT_EQ(get("data/unit/rig.blob"), "calibration");
  put("stick/unit.toml", "second");
  EXPECT_THAT(refusal(data.take_folder(path("stick"), "drawn")), HasSubstr("signed"));
  EXPECT_EQ(get("data/unit/unit.toml"), "first");
}

TEST_F(Provisioning, TakesNothingOfWhatIsNotInOrder) {
  put_stick();
  put("stick/unit.toml", "bad");
  UnitData data = unit();
  EXPECT_THAT(refusal(data.take_folder(path("stick"), "drawn")), HasSubstr("unit.toml:1"));
  EXPECT_FALSE(data.is_provisioned());
  EXPECT_EQ(data.name(), "");

  put("stick/unit.toml", "first");
  put("stick/SHA256SUMS", std::string(64, '0') + "  rig.blob\n");
  EXPECT_THAT(refusal(data.take_folder(path("stick"), "drawn")), HasSubstr("rig.blob differs"));
  put("stick/SHA256SUMS", hex_text(digest_of(bytes_of("calibration"))) + "  ./rig.blob\n");
  put("stick/name", "../elsewhere");
  EXPECT_THAT(refusal(data.take_folder(path("stick"), "drawn")), HasSubstr("unit's name"));
  std::filesystem::remove(path("stick/unit.toml"));
  put("stick/name", "wagon-1");
  EXPECT_THAT(refusal(data.take_folder(path("stick"), "drawn")), HasSubstr("no unit.toml"));
  EXPECT_FALSE(data.is_provisioned());
}

TEST_F(Provisioning, WithoutANameDrawsOneAndKeepsIt) {
  put("stick/unit.toml", "first");
  UnitData data = unit();
  EXPECT_EQ(refusal(data.take_folder(path("stick"), "unit-1234")), "");
  EXPECT_EQ(data.name(), "unit-1234");
}

TEST_F(Provisioning, OfABundleCountsFromTheNextStartOn) {
  put_stick();
  UnitData data = unit();
  ASSERT_EQ(refusal(data.take_folder(path("stick"), "")), "");
  EXPECT_EQ(refusal(take_bundle(data, sample_provisioning("wagon-1", 4))), "");
  EXPECT_EQ(get("data/unit/unit.toml"), "first");
  EXPECT_EQ(data.provision_index(), 4U);
  EXPECT_FALSE(data.is_settled());
  EXPECT_EQ(refusal(data.settle()), "");
  EXPECT_TRUE(data.is_settled());
  EXPECT_THAT(get("data/unit/unit.toml"), HasSubstr("new"));
  // It brought no calibration, so the old one stays.
  EXPECT_EQ(get("data/unit/rig.blob"), "calibration");
  EXPECT_EQ(data.provision_index(), 4U);
  EXPECT_EQ(data.name(), "wagon-1");
}

TEST_F(Provisioning, OfABundleBringsItsOwnCalibration) {
  put_stick();
  UnitData data = unit();
  ASSERT_EQ(refusal(data.take_folder(path("stick"), "")), "");
  SampleBundle bundle = sample_provisioning("wagon-1", 4);
  bundle.add("rig.blob", "calibrated anew");
  EXPECT_EQ(refusal(take_bundle(data, bundle)), "");
  EXPECT_EQ(get("data/unit/rig.blob"), "calibration");
  EXPECT_EQ(refusal(data.settle()), "");
  EXPECT_EQ(get("data/unit/rig.blob"), "calibrated anew");
}

TEST_F(Provisioning, OfABadBundleChangesNothing) {
  put_stick();
  UnitData data = unit();
  ASSERT_EQ(refusal(data.take_folder(path("stick"), "")), "");
  SampleBundle bundle = sample_provisioning("wagon-1", 4);
  bundle.manifest.parts.clear();
  bundle.parts.clear();
  bundle.add("unit.toml", "bad");
  EXPECT_THAT(refusal(take_bundle(data, bundle)), HasSubstr("unit.toml:1"));
  EXPECT_TRUE(data.is_settled());
  EXPECT_EQ(refusal(data.settle()), "");
  EXPECT_EQ(get("data/unit/unit.toml"), "first");
  EXPECT_EQ(data.provision_index(), 0U);
}

// A folder that the power cut left half made counts for nothing.
TEST_F(Provisioning, IgnoresWhatWasNotFinished) {
  put_stick();
  put("data/unit.new/unit.toml", "half");
  UnitData data = unit();
  EXPECT_FALSE(data.is_provisioned());
  EXPECT_EQ(refusal(data.settle()), "");
  EXPECT_FALSE(data.is_provisioned());
  EXPECT_EQ(refusal(data.take_folder(path("stick"), "")), "");
  EXPECT_EQ(get("data/unit/unit.toml"), "first");
}

TEST_F(Provisioning, FactoryResetKeepsNameAndCalibration) {
  put_stick();
  put("stick/notes", "secret");
  UnitData data = unit();
  ASSERT_EQ(refusal(data.take_folder(path("stick"), "")), "");
  ASSERT_EQ(refusal(data.raise_update_index(9)), "");
  put("data/unit/rig.blob.static", "learned");
  put("data/recordings/1.mcap", "people");
  put("data/update/incoming", "half");
  EXPECT_EQ(refusal(data.ask_for_reset()), "");
  EXPECT_TRUE(data.is_provisioned());  // until the next start
  EXPECT_EQ(refusal(data.settle()), "");
  EXPECT_FALSE(data.is_provisioned());
  EXPECT_TRUE(data.is_settled());
  EXPECT_EQ(data.name(), "wagon-1");
  EXPECT_EQ(data.update_index(), 9U);
  for (const char* gone : {"data/unit", "data/recordings", "data/update", "data/unit.gone"})
    EXPECT_FALSE(has(gone)) << gone;
  // New settings find the old calibration.
  put("fresh/unit.toml", "third");
  EXPECT_EQ(refusal(data.take_folder(path("fresh"), "drawn")), "");
  EXPECT_EQ(get("data/unit/rig.blob"), "calibration");
  EXPECT_EQ(get("data/unit/rig.blob.static"), "learned");
  EXPECT_EQ(data.name(), "wagon-1");
  EXPECT_FALSE(has("data/unit/notes"));
}

// At whatever step of a reset the power failed, the next start ends it, and the calibration is
// there.
TEST_F(Provisioning, FactoryResetIsFinishedAtTheNextStart) {
  put("data/identity/name", "wagon-1\n");
  put("data/reset-asked", "1\n");
  put("data/calibration/rig.blob", "calibration");
  put("data/unit.gone/unit.toml", "half removed");
  put("data/unit.gone/rig.blob.static", "left over");
  UnitData data = unit();
  EXPECT_EQ(refusal(data.settle()), "");
  EXPECT_EQ(get("data/calibration/rig.blob"), "calibration");
  EXPECT_FALSE(has("data/unit.gone"));
  EXPECT_TRUE(data.is_settled());
}

TEST_F(Provisioning, OfAnotherUnitIsRefusedAfterAReset) {
  put_stick();
  put("data/identity/name", "wagon-2\n");
  UnitData data = unit();
  EXPECT_THAT(refusal(data.take_folder(path("stick"), "")), HasSubstr("for the unit wagon-1"));
}

TEST_F(Provisioning, RollbackIndexOnlyRises) {
  UnitData data = unit();
  EXPECT_EQ(data.update_index(), 0U);
  std::filesystem::create_directories(path("data"));
  EXPECT_EQ(refusal(data.raise_update_index(7)), "");
  EXPECT_EQ(refusal(data.raise_update_index(5)), "");
  EXPECT_EQ(data.update_index(), 7U);
}

}  // namespace
}  // namespace wagonsight
