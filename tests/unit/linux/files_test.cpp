#include "linux/files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

namespace wagonsight {
namespace {

namespace fs = std::filesystem;
using ::testing::EndsWith;
using ::testing::HasSubstr;

class Files : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = ::testing::TempDir() + "wagonsight-files-XXXXXX";
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    folder_ = pattern;
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string path(const char* name) const { return folder_ + "/" + name; }
  static std::span<const std::byte> bytes(std::string_view text) {
    return std::as_bytes(std::span(text.data(), text.size()));
  }
  static std::string text_of(std::span<const std::byte> bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }

  std::string folder_;
};

TEST_F(Files, AreReadWhole) {
  const std::string text = std::string(100'000, 'a') + '\0' + "z";
  ASSERT_TRUE(write_file_durably(path("f"), bytes(text)));
  const auto read = read_file(path("f"), 1 << 20);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(*read, text);
}

TEST_F(Files, AreRefusedWithPathAndReason) {
  EXPECT_EQ(read_file(path("none"), 10).error().message,
            path("none") + ": cannot be opened: No such file or directory");
  EXPECT_EQ(read_file(folder_, 10).error().message, folder_ + ": is not a regular file");
  ASSERT_TRUE(write_file_durably(path("big"), bytes("0123456789a")));
  EXPECT_EQ(read_file(path("big"), 10).error().message,
            path("big") + ": has 11 bytes, more than the 10 that are read");
  EXPECT_THAT(MappedFile::open(path("none")).error().message,
              EndsWith("No such file or directory"));
  EXPECT_THAT(MappedFile::open(folder_).error().message, EndsWith("is not a regular file"));
  EXPECT_THAT(write_file_durably(path("no/folder"), bytes("x")).error().message,
              HasSubstr("no/folder.new: cannot be created: No such file"));
}

TEST_F(Files, AreReplacedWithoutDisturbingWhoReads) {
  ASSERT_TRUE(write_file_durably(path("f"), bytes("old")));
  const auto mapped = MappedFile::open(path("f"));
  ASSERT_TRUE(mapped);
  ASSERT_TRUE(write_file_durably(path("f"), bytes("a new one")));
  EXPECT_EQ(text_of(mapped->bytes()), "old");
  EXPECT_EQ(*read_file(path("f"), 100), "a new one");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator{}), 1);
}

TEST_F(Files, MapEmptyFiles) {
  ASSERT_TRUE(write_file_durably(path("f"), {}));
  const auto mapped = MappedFile::open(path("f"));
  ASSERT_TRUE(mapped);
  EXPECT_TRUE(mapped->bytes().empty());
}

TEST_F(Files, MoveTheirMapping) {
  ASSERT_TRUE(write_file_durably(path("f"), bytes("mapped")));
  auto first = MappedFile::open(path("f"));
  ASSERT_TRUE(first);
  MappedFile second = std::move(*first);
  EXPECT_TRUE(first->bytes().empty());  // NOLINT(bugprone-use-after-move)
  EXPECT_EQ(text_of(second.bytes()), "mapped");
}

Result<void> must_begin_with_good(std::span<const std::byte> bytes) {
  if (std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size())
          .starts_with("good"))
    return {};
  return fail("does not begin with good");
}

TEST_F(Files, FallBackToThePreviousOne) {
  const std::string p = path("rig.blob");
  EXPECT_THAT(open_file_or_previous(p, must_begin_with_good).error().message,
              HasSubstr("rig.blob.previous: cannot be opened"));

  ASSERT_TRUE(replace_file_keeping_previous(p, bytes("good 1")));
  EXPECT_FALSE(fs::exists(p + ".previous"));
  ASSERT_TRUE(replace_file_keeping_previous(p, bytes("good 2")));
  EXPECT_EQ(*read_file(p + ".previous", 100), "good 1");
  auto opened = open_file_or_previous(p, must_begin_with_good);
  ASSERT_TRUE(opened);
  EXPECT_EQ(opened->path, p);
  EXPECT_EQ(opened->refusal, "");
  EXPECT_EQ(text_of(opened->file.bytes()), "good 2");

  ASSERT_TRUE(replace_file_keeping_previous(p, bytes("damaged")));
  opened = open_file_or_previous(p, must_begin_with_good);
  ASSERT_TRUE(opened);
  EXPECT_EQ(opened->path, p + ".previous");
  EXPECT_EQ(opened->refusal, p + ": does not begin with good");
  EXPECT_EQ(text_of(opened->file.bytes()), "good 2");

  fs::remove(p);
  opened = open_file_or_previous(p, must_begin_with_good);
  ASSERT_TRUE(opened);
  EXPECT_THAT(opened->refusal, HasSubstr("rig.blob: cannot be opened"));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator{}), 1);
}

}  // namespace
}  // namespace wagonsight
