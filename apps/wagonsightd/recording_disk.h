#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "base/result.h"

namespace wagonsight {

// What the recorder needs of a file and of a disk; tests have slow, full and vanishing ones.
class RecordingFile {
 public:
  virtual ~RecordingFile() = default;
  // After an Error some of the bytes may be in the file.
  virtual Result<void> append(std::span<const std::byte> bytes) = 0;
  // Until it returns, a power cut may take what was appended.
  virtual Result<void> sync() = 0;
  virtual Result<void> cut_to(std::uint64_t size) = 0;
};

class RecordingDisk {
 public:
  virtual ~RecordingDisk() = default;
  virtual Result<void> make_folder(const std::string& folder) = 0;
  virtual bool exists(const std::string& path) = 0;
  // A new file; one that exists is an Error.
  virtual Result<std::unique_ptr<RecordingFile>> create(const std::string& path) = 0;
  virtual Result<std::uint64_t> free_bytes(const std::string& folder) = 0;
};

// The machine's own.
RecordingDisk& system_disk();

}  // namespace wagonsight
