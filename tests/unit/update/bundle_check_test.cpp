#include "update/bundle_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "support/sample_bundle.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;

// What the unit says of the file; empty: it takes it.
std::string refusal(const std::string& file, const BundleRules& rules = sample_rules(),
                    std::size_t piece = 4096) {
  BundleCheck check(rules);
  for (std::size_t at = 0; at < file.size(); at += piece)
    if (const auto taken = check.take(bytes_of(std::string_view(file).substr(at, piece))); !taken)
      return taken.error().message;
  const auto done = check.finish();
  return done ? std::string() : done.error().message;
}

TEST(Bundle, IsTakenWhenAllIsInOrder) {
  EXPECT_EQ(refusal(sample_update().file()), "");
  EXPECT_EQ(refusal(sample_update(0).file()), "");
  EXPECT_EQ(refusal(sample_provisioning("wagon-1", 1).file()), "");
}

RC_GTEST_PROP(Bundle, IsTakenInAnyPieces, ()) {
  const auto piece = *rc::gen::inRange<std::size_t>(1, 300'000);
  RC_ASSERT(refusal(sample_update().file(), sample_rules(), piece).empty());
}

// The heart of it: no single bit can be changed without the unit saying so.
RC_GTEST_PROP(Bundle, IsRefusedWithAnyFlippedBit, ()) {
  static const std::string good = sample_update().file();
  std::string file = good;
  // As often in the head as in the payload.
  const std::size_t head = good.size() - sample_update().manifest.payload_bytes();
  const auto at = *rc::gen::oneOf(rc::gen::inRange<std::size_t>(0, head),
                                  rc::gen::inRange<std::size_t>(head, file.size()));
  file[at] = static_cast<char>(file[at] ^ (1 << *rc::gen::inRange(0, 8)));
  const std::string said = refusal(file);
  RC_ASSERT(!said.empty());
  if (at >= head) RC_ASSERT(said.find("chunk") != std::string::npos);
}

RC_GTEST_PROP(Bundle, IsRefusedWhereverItIsCutOff, ()) {
  static const std::string good = sample_update().file();
  const auto size = *rc::gen::inRange<std::size_t>(0, good.size());
  RC_ASSERT(refusal(good.substr(0, size)).find("cut off") != std::string::npos);
}

TEST(Bundle, NamesTheChunkOfAFlippedBit) {
  std::string file = sample_update().file();
  const std::size_t payload = file.size() - sample_update().manifest.payload_bytes();
  file[payload + 2 * kChunkBytes] ^= 4;
  EXPECT_THAT(refusal(file), HasSubstr("chunk 3 of 4 in part root (its bytes from 131072)"));
}

TEST(Bundle, OfACutFileIsRefusedAtItsManifestWhenTheSizeIsKnown) {
  const std::string file = sample_update().file();
  BundleCheck check(sample_rules(), file.size() - 1);
  const auto taken = check.take(bytes_of(std::string_view(file).substr(0, 4096)));
  ASSERT_FALSE(taken);
  EXPECT_THAT(taken.error().message, HasSubstr("cut off"));
}

TEST(Bundle, IsRefusedByAnotherKey) {
  const std::string file = sample_update().file(sample_seed(2));
  EXPECT_THAT(refusal(file), HasSubstr("does not trust"));
  // One who only writes the trusted key's number into the header has not signed with it.
  std::string forged = file;
  const KeyId id = key_id(public_key_of(sample_seed()));
  for (std::size_t i = 0; i < id.size(); ++i) forged[8 + i] = static_cast<char>(id[i]);
  EXPECT_THAT(refusal(forged), HasSubstr("signature does not fit"));
}

TEST(Bundle, IsRefusedByAnImageWithoutAKey) {
  BundleRules rules = sample_rules();
  rules.update_key = rules.provision_key = std::nullopt;
  EXPECT_THAT(refusal(sample_update().file(), rules), HasSubstr("without a public key"));
}

TEST(Bundle, IsRefusedWhenItIsOlder) {
  BundleRules rules = sample_rules();
  rules.update_index = 11;
  EXPECT_THAT(refusal(sample_update().file(), rules), HasSubstr("older"));
  rules.update_index = 10;  // the same again may be
  EXPECT_EQ(refusal(sample_update().file(), rules), "");
}

TEST(Bundle, IsRefusedByAnotherArchitecture) {
  BundleRules rules = sample_rules();
  rules.architecture = "aarch64";
  EXPECT_THAT(refusal(sample_update().file(), rules), HasSubstr("architecture x86_64"));
}

TEST(Bundle, OfProvisioningIsForOneUnitAndOnce) {
  EXPECT_THAT(refusal(sample_provisioning("wagon-2", 1).file()), HasSubstr("unit wagon-2"));
  BundleRules rules = sample_rules();
  rules.provision_index = 1;
  EXPECT_THAT(refusal(sample_provisioning("wagon-1", 1).file(), rules), HasSubstr("already"));
  EXPECT_EQ(refusal(sample_provisioning("wagon-1", 2).file(), rules), "");
}

TEST(Bundle, MayBeSignedOnlyByItsKindsKey) {
  BundleRules rules = sample_rules();
  rules.provision_key = public_key_of(sample_seed(2));
  EXPECT_THAT(refusal(sample_update().file(sample_seed(2)), rules), HasSubstr("may not sign"));
  EXPECT_THAT(refusal(sample_provisioning("wagon-1", 1).file(), rules), HasSubstr("may not sign"));
  EXPECT_EQ(refusal(sample_provisioning("wagon-1", 1).file(sample_seed(2)), rules), "");
}

TEST(Bundle, LacksNoPartOfASlot) {
  SampleBundle bundle = sample_update();
  bundle.manifest.parts.pop_back();
  bundle.parts.pop_back();
  EXPECT_THAT(refusal(bundle.file()), HasSubstr("no part initramfs"));
}

TEST(Bundle, EndsWhereItEnds) {
  EXPECT_THAT(refusal(sample_update().file() + "x"), HasSubstr("goes on"));
  EXPECT_THAT(refusal("GIF89a" + std::string(200, ' ')), HasSubstr("no wagonsight bundle"));
}

TEST(Bundle, StaysRefused) {
  BundleCheck check(sample_rules());
  ASSERT_FALSE(check.take(bytes_of(std::string(100, 'x'))));
  EXPECT_FALSE(check.take(bytes_of(sample_update().file())));
  EXPECT_FALSE(check.finish());
}

TEST(Keys, AreReadAsTheyAreWritten) {
  const PublicKey key = public_key_of(sample_seed());
  const auto read = read_key(key_text(key), "k");
  ASSERT_TRUE(read);
  EXPECT_EQ(*read, key);
  EXPECT_FALSE(read_key("12", "k"));
  EXPECT_FALSE(read_key(std::string(64, 'g'), "k"));
}

// RFC 8032, 7.1, test 2: so that keys and signatures are those of everybody else.
TEST(Keys, SignAsTheStandardSays) {
  SigningSeed seed{};
  ASSERT_TRUE(read_hex("4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb", seed));
  EXPECT_EQ(hex_text(public_key_of(seed)),
            "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c");
  EXPECT_EQ(hex_text(sign("r", seed)),
            "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da"
            "085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00");
}

}  // namespace
}  // namespace wagonsight
