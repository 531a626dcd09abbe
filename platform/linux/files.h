#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "base/result.h"

// Files, as the appliance uses them: read whole, mapped, or replaced so that a power cut leaves
// either the old one or the new one. Every Error names the path and the system's reason.
namespace wagonsight {

// The whole of a regular file of at most `bytes_max`.
Result<std::string> read_file(const std::string& path, std::size_t bytes_max);

// Writes a file so that, whenever the power fails, `path` is the old file or the whole new one: a
// temporary file beside it, fsync, rename, fsync of the directory. Readers who have the old file
// open or mapped keep it.
Result<void> write_file_durably(const std::string& path, std::span<const std::byte> bytes);

// A file mapped read-only. The file must be replaced (write_file_durably), never written in place:
// who reads a page that was cut off is killed by SIGBUS.
class MappedFile {
 public:
  enum class Pages {
    kResident,  // all of them, from the start: reading never waits for the disk
    kOnDemand,  // each when it is first read: a recording may be larger than the memory
  };
  MappedFile() = default;
  MappedFile(MappedFile&& other) noexcept { swap(other); }
  MappedFile& operator=(MappedFile&& other) noexcept {
    swap(other);
    return *this;
  }
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  ~MappedFile();

  static Result<MappedFile> open(const std::string& path, Pages pages = Pages::kResident);

  // Page-aligned; empty for an empty file.
  std::span<const std::byte> bytes() const { return bytes_; }
  std::string_view text() const {
    return {reinterpret_cast<const char*>(bytes_.data()), bytes_.size()};
  }
  // Gives the first `count` bytes back to the system until they are read again.
  void let_go(std::size_t count) const;

 private:
  void swap(MappedFile& other) noexcept { std::swap(bytes_, other.bytes_); }
  std::span<const std::byte> bytes_;
};

// ---- a file and the one it replaced

// The file that passed its check.
struct CheckedFile {
  MappedFile file;
  std::string path;     // PATH or PATH.previous
  std::string refusal;  // why PATH was refused when this is PATH.previous; otherwise empty
};
using FileCheck = std::function<Result<void>(std::span<const std::byte>)>;

// Opens PATH, or PATH.previous when PATH is absent or `check` refuses it. The Error tells why
// neither can be used.
Result<CheckedFile> open_file_or_previous(const std::string& path, const FileCheck& check);

// Makes PATH the given bytes, durably, and PATH.previous what PATH was (if it was there). At no
// time is there neither.
Result<void> replace_file_keeping_previous(const std::string& path,
                                           std::span<const std::byte> bytes);

}  // namespace wagonsight
