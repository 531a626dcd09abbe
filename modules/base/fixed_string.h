#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <string_view>

namespace wagonsight {

// A name or a sentence of at most N bytes, stored in place; flat, so it may live in shared memory.
// Longer text is cut. Never allocates.
template <std::size_t N>
class FixedString {
 public:
  constexpr FixedString() = default;
  constexpr FixedString(std::string_view text) { assign(text); }  // NOLINT: a name is text
  constexpr FixedString(const char* text) : FixedString(std::string_view(text)) {}  // NOLINT

  constexpr void assign(std::string_view text) {
    size_ = std::min(text.size(), N);
    for (std::size_t i = 0; i < N; ++i) bytes_[i] = i < size_ ? text[i] : '\0';
  }
  constexpr std::string_view view() const { return {bytes_.data(), size_}; }
  constexpr operator std::string_view() const { return view(); }  // NOLINT
  constexpr bool empty() const { return size_ == 0; }
  static constexpr std::size_t capacity() { return N; }

  friend constexpr bool operator==(const FixedString& a, std::string_view b) {
    return a.view() == b;
  }
  friend constexpr bool operator==(const FixedString& a, const char* b) {
    return a.view() == std::string_view(b);
  }
  friend constexpr bool operator==(const FixedString& a, const FixedString& b) {
    return a.view() == b.view();
  }

 private:
  std::size_t size_ = 0;
  std::array<char, N> bytes_{};
};

using Name = FixedString<40>;

}  // namespace wagonsight
