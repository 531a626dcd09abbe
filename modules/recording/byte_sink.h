#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "base/result.h"

namespace wagonsight {

// Where encoded bytes go: a file, in the program that has files, or memory. Called by the one
// thread that writes the recording; every call hands over whole records, so that what reached the
// disk before a power cut is readable.
class ByteSink {
 public:
  virtual ~ByteSink() = default;
  virtual Result<void> write(std::span<const std::byte> bytes) = 0;
};

// Keeps everything; for tests and small recordings.
class MemorySink final : public ByteSink {
 public:
  Result<void> write(std::span<const std::byte> bytes) override {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
    return {};
  }
  std::span<const std::byte> bytes() const { return bytes_; }

 private:
  std::vector<std::byte> bytes_;
};

}  // namespace wagonsight
