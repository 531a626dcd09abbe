#include "slots/file_slot.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "linux/append_file.h"
#include "linux/files.h"
#include "slots/boot_entries.h"
#include "slots/folders.h"

namespace wagonsight {
namespace {

tl::unexpected<Error> failed(std::string_view path, const char* what) {
  return fail(fmt::format("{}: {}: {}", path, what, std::strerror(errno)));
}

}  // namespace

FileSlot::FileSlot(char letter, std::string root_device, std::string boot_folder)
    : letter_(letter), root_device_(std::move(root_device)), boot_folder_(std::move(boot_folder)) {}

FileSlot::~FileSlot() {
  for (const auto& [part, fd] : open_) close(fd);
}

Result<std::string> FileSlot::path_of(std::string_view part) const {
  if (part == "root") return root_device_;
  if (part == "kernel") return fmt::format("{}/{}/vmlinuz", boot_folder_, letter_);
  if (part == "initramfs") return fmt::format("{}/{}/initramfs", boot_folder_, letter_);
  return fail(fmt::format("a slot has no part {}; this unit is too old for the bundle", part));
}

Result<int> FileSlot::open_part(std::string_view part) {
  if (const auto known = open_.find(part); known != open_.end()) return known->second;
  auto path = path_of(part);
  if (!path) return tl::unexpected(path.error());
  // The partition must be there; the files of the boot partition may be new.
  const bool is_file = part != "root";
  if (is_file)
    if (auto made = make_folders(fmt::format("{}/{}", boot_folder_, letter_)); !made)
      return tl::unexpected(made.error());
  const int fd = open(path->c_str(), O_RDWR | O_CLOEXEC | (is_file ? O_CREAT : 0), 0644);
  if (fd < 0) return failed(*path, "cannot be opened");
  open_.emplace(part, fd);
  return fd;
}

Result<void> FileSlot::prepare(const BundlePart& part) {
  const auto fd = open_part(part.name);
  if (!fd) return tl::unexpected(fd.error());
  const off_t room = lseek(*fd, 0, SEEK_END);
  if (part.name != "root") {
    if (room > static_cast<off_t>(part.bytes) &&
        ftruncate(*fd, static_cast<off_t>(part.bytes)) != 0)
      return failed(part.name, "cannot be made shorter");
  } else if (room < static_cast<off_t>(part.bytes)) {
    return fail(
        fmt::format("the update's root has {} bytes, and its partition {} has room for {}; "
                    "flash a whole image instead",
                    part.bytes, root_device_, room));
  }
  return {};
}

Result<bool> FileSlot::read(std::string_view part, std::uint64_t offset,
                            std::span<std::byte> bytes) {
  const auto fd = open_part(part);
  if (!fd) return tl::unexpected(fd.error());
  while (!bytes.empty()) {
    const ssize_t got = pread(*fd, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return failed(part, "cannot be read");
    if (got == 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(got));
    offset += static_cast<std::uint64_t>(got);
  }
  return true;
}

Result<void> FileSlot::write(std::string_view part, std::uint64_t offset,
                             std::span<const std::byte> bytes) {
  const auto fd = open_part(part);
  if (!fd) return tl::unexpected(fd.error());
  while (!bytes.empty()) {
    const ssize_t put = pwrite(*fd, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) return failed(part, "cannot be written");
    bytes = bytes.subspan(static_cast<std::size_t>(put));
    offset += static_cast<std::uint64_t>(put);
  }
  return {};
}

Result<void> FileSlot::sync() {
  for (const auto& [part, fd] : open_) {
    // What the system remembers is let go, so that reading asks the disk.
    if (fsync(fd) != 0 || posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED) != 0)
      return failed(part, "cannot be written to the disk");
    close(fd);
  }
  open_.clear();
  const std::string folder = fmt::format("{}/{}", boot_folder_, letter_);
  return file_exists(folder) ? sync_folder(folder) : Result<void>{};
}

Result<void> FileSlot::unlist() {
  const std::string folder = boot_folder_ + "/loader/entries";
  for (const BootEntry& entry : boot_entries(boot_folder_))
    if (entry.slot == letter_ && unlink((folder + "/" + entry.file).c_str()) != 0)
      return failed(entry.file, "cannot be removed");
  return sync_folder(folder);
}

Result<void> FileSlot::list(std::string_view version, std::string_view options) {
  const NewEntry entry = new_boot_entry(boot_entries(boot_folder_), letter_,
                                        fmt::format("wagonsight {}", version), options);
  return write_file_durably(boot_folder_ + "/loader/entries/" + entry.file,
                            std::as_bytes(std::span(entry.text.data(), entry.text.size())));
}

}  // namespace wagonsight
