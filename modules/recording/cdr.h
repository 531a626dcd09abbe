#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>

#include "recording/little_endian.h"

namespace wagonsight {

// Appends one CDR message to a ByteWriter. Alignment counts from behind the encapsulation header.
class CdrWriter {
 public:
  explicit CdrWriter(ByteWriter& out) : out_(out) {
    constexpr std::byte kLittleEndianCdr[4] = {std::byte{0}, std::byte{1}, std::byte{0},
                                               std::byte{0}};
    out_.raw(kLittleEndianCdr);
    origin_ = out_.size();
  }

  template <class T>
  void number(T value) {
    while ((out_.size() - origin_) % sizeof(T) != 0) out_.number(std::uint8_t{0});
    out_.number(value);
  }
  // The length of a CDR string counts its final zero byte.
  void text(std::string_view value) {
    number(static_cast<std::uint32_t>(value.size() + 1));
    out_.raw(std::as_bytes(std::span(value.data(), value.size())));
    out_.number(std::uint8_t{0});
  }

 private:
  ByteWriter& out_;
  std::size_t origin_ = 0;
};

// Reads one CDR message of either byte order. Past the end: zeros, and ok() is false for good.
class CdrReader {
 public:
  explicit CdrReader(std::span<const std::byte> message) : reader_(message) {
    const auto header = reader_.raw(kEncapsulationBytes);
    // Plain CDR only: 0 big-endian, 1 little-endian.
    is_known_ = header.size() == kEncapsulationBytes && header[0] == std::byte{0} &&
                header[1] <= std::byte{1};
    swaps_ = is_known_ && header[1] == std::byte{0};
  }

  template <class T>
  T number() {
    const std::size_t misfit = (reader_.position() - kEncapsulationBytes) % sizeof(T);
    if (misfit != 0) reader_.raw(sizeof(T) - misfit);
    T value = reader_.number<T>();
    if (swaps_) {
      auto* bytes = reinterpret_cast<unsigned char*>(&value);
      for (std::size_t i = 0; i < sizeof(T) / 2; ++i) std::swap(bytes[i], bytes[sizeof(T) - 1 - i]);
    }
    return value;
  }
  std::string_view text() {
    const auto size = number<std::uint32_t>();
    const auto part = reader_.raw(size);
    if (part.empty()) return {};
    return {reinterpret_cast<const char*>(part.data()), part.size() - 1};
  }
  std::span<const std::byte> raw(std::size_t size) { return reader_.raw(size); }

  bool ok() const { return is_known_ && reader_.ok(); }

 private:
  static constexpr std::size_t kEncapsulationBytes = 4;
  ByteReader reader_;
  bool is_known_ = false;
  bool swaps_ = false;
};

}  // namespace wagonsight
