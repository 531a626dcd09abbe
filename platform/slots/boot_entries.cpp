#include "slots/boot_entries.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "linux/files.h"
#include "slots/folders.h"
#include "slots/key_lines.h"

namespace wagonsight {
namespace {

constexpr std::size_t kEntryBytesMax = 16'384;

std::string entries_folder(const std::string& boot_folder) {
  return boot_folder + "/loader/entries";
}

bool read_name(std::string_view name, BootEntry& entry) {
  if (!name.ends_with(".conf") || name.size() < 6) return false;
  entry.file = name;
  entry.slot = name[0];
  const std::string_view middle = name.substr(1, name.size() - 6);
  entry.is_good = middle.empty();
  if (!middle.empty() && middle[0] == '+') entry.tries_left = leading_number<int>(middle.substr(1));
  return (entry.slot == 'a' || entry.slot == 'b') && (middle.empty() || middle[0] == '+');
}

}  // namespace

std::vector<BootEntry> boot_entries(const std::string& boot_folder) {
  std::vector<BootEntry> entries;
  std::error_code ignored;
  for (const auto& file :
       std::filesystem::directory_iterator(entries_folder(boot_folder), ignored)) {
    BootEntry entry;
    if (!read_name(file.path().filename().string(), entry)) continue;
    const auto text = read_file(file.path().string(), kEntryBytesMax);
    if (!text) continue;
    entry.version = leading_number<std::uint64_t>(line_value(*text, "version"));
    entry.title = line_value(*text, "title");
    entries.push_back(std::move(entry));
  }
  return entries;
}

bool is_slot_good(const std::vector<BootEntry>& entries, char slot) {
  return std::any_of(entries.begin(), entries.end(),
                     [&](const BootEntry& entry) { return entry.slot == slot && entry.is_good; });
}

NewEntry new_boot_entry(const std::vector<BootEntry>& entries, char slot, std::string_view title,
                        std::string_view options) {
  std::uint64_t version = 0;
  for (const BootEntry& entry : entries) version = std::max(version, entry.version);
  return {fmt::format("{}+3.conf", slot),
          fmt::format("title {0}\nsort-key wagonsight\nversion {1}\nlinux /{2}/vmlinuz\n"
                      "initrd /{2}/initramfs\noptions {3} slot={2}\n",
                      title, version + 1, slot, options)};
}

Result<bool> mark_slot_good(const std::string& boot_folder, char slot) {
  const std::string folder = entries_folder(boot_folder);
  bool had_counter = false;
  for (const BootEntry& entry : boot_entries(boot_folder)) {
    if (entry.slot != slot || entry.is_good) continue;
    const std::string from = folder + "/" + entry.file;
    const std::string to = fmt::format("{}/{}.conf", folder, slot);
    if (std::rename(from.c_str(), to.c_str()) != 0)
      return fail(fmt::format("{}: cannot be renamed: {}", from, std::strerror(errno)));
    had_counter = true;
  }
  if (auto synced = sync_folder(folder); !synced) return tl::unexpected(synced.error());
  return had_counter;
}

}  // namespace wagonsight
