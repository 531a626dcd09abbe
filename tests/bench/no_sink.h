#pragma once

#include <cstddef>
#include <span>

#include "recording/byte_sink.h"

namespace wagonsight::bench {

// Takes bytes and forgets them: the encoder is measured, no disk.
class NoSink final : public ByteSink {
 public:
  Result<void> write(std::span<const std::byte> bytes) override {
    bytes_ += bytes.size();
    return {};
  }
  std::size_t bytes() const { return bytes_; }

 private:
  std::size_t bytes_ = 0;
};

}  // namespace wagonsight::bench
