#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "base/result.h"

namespace wagonsight {

// A file that only grows, for what must survive a power cut. Every Error names the path and the
// system's reason. One thread; each call may take as long as the disk does.
class AppendFile {
 public:
  // Makes a new file, and its directory's entry durable; one that exists is never touched.
  static Result<std::unique_ptr<AppendFile>> create(const std::string& path);
  ~AppendFile();
  AppendFile(const AppendFile&) = delete;
  AppendFile& operator=(const AppendFile&) = delete;

  // After an Error some of the bytes may be in the file.
  Result<void> append(std::span<const std::byte> bytes);
  // What was appended is on the disk from then on.
  Result<void> sync();
  // Drops what lies behind the first `size` bytes.
  Result<void> cut_to(std::uint64_t size);

 private:
  AppendFile(std::string path, int fd) : path_(std::move(path)), fd_(fd) {}
  std::string path_;
  int fd_;
};

// Bytes that an ordinary user may still write where `folder` is.
Result<std::uint64_t> free_disk_bytes(const std::string& folder);

// Makes the folder, and those above it, when it is not there.
Result<void> make_folders(const std::string& folder);

bool file_exists(const std::string& path);

}  // namespace wagonsight
