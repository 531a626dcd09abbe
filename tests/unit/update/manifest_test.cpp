#include "update/manifest.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "support/sample_bundle.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;

std::string refusal(std::string_view text) {
  const auto manifest = parse_manifest(text);
  return manifest ? std::string() : manifest.error().message;
}

std::string with(std::string text, std::string_view from, std::string_view to) {
  return text.replace(text.find(from), from.size(), to);
}

RC_GTEST_PROP(Manifest, IsReadAsItWasWritten, ()) {
  const auto size = *rc::gen::inRange<std::size_t>(0, 300'000);
  SampleBundle bundle = sample_update(size);
  bundle.manifest.index = *rc::gen::arbitrary<std::uint64_t>();
  const auto read = parse_manifest(manifest_text(bundle.manifest));
  RC_ASSERT(read.has_value());
  RC_ASSERT(manifest_text(*read) == manifest_text(bundle.manifest));
  RC_ASSERT(read->payload_bytes() == size + 71'000);
  RC_ASSERT(read->part("root")->chunks.size() == (size + kChunkBytes - 1) / kChunkBytes);
}

// Its readers are behind a signature, but a key may be lost.
RC_GTEST_PROP(Manifest, SurvivesAnyText, ()) {
  std::string text = manifest_text(sample_update().manifest);
  const auto count = *rc::gen::inRange(1, 6);
  for (int i = 0; i < count; ++i) {
    const auto at = *rc::gen::inRange<std::size_t>(0, text.size());
    if (*rc::gen::arbitrary<bool>())
      text[at] = *rc::gen::arbitrary<char>();
    else
      text.erase(at, *rc::gen::inRange<std::size_t>(1, 80));
    if (text.empty()) break;
  }
  const auto read = parse_manifest(text);
  if (read) RC_ASSERT(manifest_text(*read).size() <= text.size());
}

TEST(Manifest, NamesTheLineThatIsWrong) {
  const std::string good = manifest_text(sample_update().manifest);
  EXPECT_EQ(refusal(good), "");
  EXPECT_THAT(refusal(with(good, "bundle 1", "bundle 2")), HasSubstr("another format"));
  EXPECT_THAT(refusal(with(good, "kind update", "kind upgrade")), HasSubstr("line 2"));
  EXPECT_THAT(refusal(with(good, "index 10", "index -1")), HasSubstr("whole number"));
  EXPECT_THAT(refusal(with(good, "part kernel", "part ../x")), HasSubstr("part NAME BYTES"));
  EXPECT_THAT(refusal(with(good, "part kernel", "part root")), HasSubstr("second time"));
  EXPECT_THAT(refusal(with(good, "part root 200000", "part root 999999999999")),
              HasSubstr("larger than any"));
  EXPECT_THAT(refusal(good.substr(0, good.size() - 5)), HasSubstr("should begin with \"chunk \""));
  EXPECT_THAT(refusal(good.substr(0, good.find("part"))), HasSubstr("no part"));
}

TEST(Manifest, TakesNoNameThatLeadsElsewhere) {
  for (const char* name : {"", ".", "..", "a/b", "a b", "a\n", ".hidden"})
    EXPECT_FALSE(is_part_name(name)) << name;
  EXPECT_TRUE(is_part_name("rig.blob.static"));
}

}  // namespace
}  // namespace wagonsight
