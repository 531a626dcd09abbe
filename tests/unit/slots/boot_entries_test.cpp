#include "slots/boot_entries.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/scratch_folder.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;
using BootEntries = ScratchFolder;

TEST_F(BootEntries, AreReadFromTheirNames) {
  put("loader/entries/a.conf", "title wagonsight 1\nsort-key wagonsight\nversion 2\n");
  put("loader/entries/b+2-1.conf", "title wagonsight 2\nversion 3\n");
  put("loader/entries/other.conf", "title memory test\nversion 99\n");
  put("loader/entries/b+3.conf.new", "half of");
  const auto entries = boot_entries(folder_);
  ASSERT_EQ(entries.size(), 2U);
  EXPECT_TRUE(is_slot_good(entries, 'a'));
  EXPECT_FALSE(is_slot_good(entries, 'b'));
  for (const BootEntry& entry : entries)
    if (entry.slot == 'b') {
      EXPECT_EQ(entry.tries_left, 2);
      EXPECT_EQ(entry.version, 3U);
      EXPECT_EQ(entry.title, "wagonsight 2");
    }
}

// systemd-boot sorts entries of one key by falling version, as long as tries are left.
TEST_F(BootEntries, NewOneComesFirstWithThreeTries) {
  put("loader/entries/a.conf", "sort-key wagonsight\nversion 41\n");
  const NewEntry entry = new_boot_entry(boot_entries(folder_), 'b', "wagonsight 2", "quiet");
  EXPECT_EQ(entry.file, "b+3.conf");
  EXPECT_THAT(entry.text, HasSubstr("\nversion 42\n"));
  EXPECT_THAT(entry.text, HasSubstr("\nsort-key wagonsight\n"));
  EXPECT_THAT(entry.text, HasSubstr("\noptions quiet slot=b\n"));
  EXPECT_THAT(entry.text, HasSubstr("\nlinux /b/vmlinuz\ninitrd /b/initramfs\n"));
}

TEST_F(BootEntries, LoseTheirCounterWhenGood) {
  put("loader/entries/a+1-2.conf", "version 1\n");
  put("loader/entries/b+3.conf", "version 2\n");
  auto marked = mark_slot_good(folder_, 'a');
  ASSERT_TRUE(marked);
  EXPECT_TRUE(*marked);
  EXPECT_TRUE(has("loader/entries/a.conf") && has("loader/entries/b+3.conf"));
  EXPECT_FALSE(has("loader/entries/a+1-2.conf"));
  marked = mark_slot_good(folder_, 'a');
  ASSERT_TRUE(marked);
  EXPECT_FALSE(*marked);
}

}  // namespace
}  // namespace wagonsight
