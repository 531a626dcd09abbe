#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <type_traits>
#include <vector>

namespace wagonsight {

static_assert(std::endian::native == std::endian::little, "the files are written as memory lies");

// Appends numbers and length-prefixed text as MCAP serialises them. Allocates only while its
// buffer is below the largest size it ever had.
class ByteWriter {
 public:
  template <class T>
  void number(T value) {
    static_assert(std::is_arithmetic_v<T>);
    raw(std::as_bytes(std::span(&value, 1)));
  }
  void raw(std::span<const std::byte> bytes) {
    const std::size_t at = buffer_.size();
    buffer_.resize(at + bytes.size());
    if (!bytes.empty()) std::memcpy(buffer_.data() + at, bytes.data(), bytes.size());
  }
  void text(std::string_view value) {
    number(static_cast<std::uint32_t>(value.size()));
    raw(std::as_bytes(std::span(value.data(), value.size())));
  }
  // A place for a number that is only known later.
  template <class T>
  std::size_t reserve() {
    const std::size_t at = buffer_.size();
    number(T{0});
    return at;
  }
  template <class T>
  void patch(std::size_t at, T value) {
    std::memcpy(buffer_.data() + at, &value, sizeof value);
  }

  std::size_t size() const { return buffer_.size(); }
  bool empty() const { return buffer_.empty(); }
  void clear() { buffer_.clear(); }
  void reserve_bytes(std::size_t capacity) { buffer_.reserve(capacity); }
  std::span<const std::byte> bytes() const { return buffer_; }

 private:
  std::vector<std::byte> buffer_;
};

// Reads them back. Reading past the end gives zeros and makes ok() false for good; nothing is
// copied except numbers.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

  template <class T>
  T number() {
    static_assert(std::is_arithmetic_v<T>);
    T value{};
    const auto from = raw(sizeof value);
    if (ok_) std::memcpy(&value, from.data(), sizeof value);
    return value;
  }
  std::span<const std::byte> raw(std::uint64_t size) {
    if (!ok_ || size > bytes_.size() - position_) {
      ok_ = false;
      return {};
    }
    const auto part = bytes_.subspan(position_, static_cast<std::size_t>(size));
    position_ += part.size();
    return part;
  }
  std::string_view text() {
    const auto part = raw(number<std::uint32_t>());
    return {reinterpret_cast<const char*>(part.data()), part.size()};
  }

  bool ok() const { return ok_; }
  std::size_t position() const { return position_; }
  std::size_t remaining() const { return bytes_.size() - position_; }

 private:
  std::span<const std::byte> bytes_;
  std::size_t position_ = 0;
  bool ok_ = true;
};

}  // namespace wagonsight
