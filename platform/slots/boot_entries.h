#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"

// The loader's entries, one file a slot in loader/entries of the boot partition: "a.conf" is good,
// "a+3.conf" has three tries left, "a+0-3.conf" none (boot counting of systemd-boot, which renames
// the file at every try). All have the same sort key, so the entry with the highest version comes
// first, as long as it has tries left.
namespace wagonsight {

struct BootEntry {
  std::string file;  // its name in the folder
  char slot = 'a';
  bool is_good = false;  // without a counter
  int tries_left = 0;
  std::uint64_t version = 0;  // of its order
  std::string title;
};

// Those of the slots; files of other names are left alone. Empty when the folder cannot be read.
std::vector<BootEntry> boot_entries(const std::string& boot_folder);

bool is_slot_good(const std::vector<BootEntry>& entries, char slot);

// A new entry with three tries, before all that there are.
struct NewEntry {
  std::string file, text;
};
NewEntry new_boot_entry(const std::vector<BootEntry>& entries, char slot, std::string_view title,
                        std::string_view options);

// Takes the counter from the slot's entry. True when it had one.
Result<bool> mark_slot_good(const std::string& boot_folder, char slot);

}  // namespace wagonsight
