#include "snapshot/json_text.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>

namespace wagonsight {
namespace {

// Length of the UTF-8 character at the start of `text`, 0 when there is none (RFC 3629, table of
// section 4: no overlong forms, no surrogates, nothing above U+10FFFF).
std::size_t utf8_length(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<std::uint8_t>(text[i]); };
  const auto continues = [&](std::size_t i, std::uint8_t low = 0x80, std::uint8_t high = 0xBF) {
    return i < text.size() && byte(i) >= low && byte(i) <= high;
  };
  const std::uint8_t first = byte(0);
  if (first < 0x80) return 1;
  if (first >= 0xC2 && first <= 0xDF) return continues(1) ? 2 : 0;
  if (first >= 0xE0 && first <= 0xEF) {
    const std::uint8_t low = first == 0xE0 ? 0xA0 : 0x80;
    const std::uint8_t high = first == 0xED ? 0x9F : 0xBF;
    return continues(1, low, high) && continues(2) ? 3 : 0;
  }
  if (first >= 0xF0 && first <= 0xF4) {
    const std::uint8_t low = first == 0xF0 ? 0x90 : 0x80;
    const std::uint8_t high = first == 0xF4 ? 0x8F : 0xBF;
    return continues(1, low, high) && continues(2) && continues(3) ? 4 : 0;
  }
  return 0;
}

void append_control(std::string& out, char c) {
  constexpr std::string_view kHex = "0123456789abcdef";
  const auto code = static_cast<std::uint8_t>(c);
  out += "\\u00";
  out += kHex[code >> 4U];
  out += kHex[code & 15U];
}

__extension__ using Wide = unsigned __int128;

constexpr std::array<std::uint64_t, 10> kTens = {
    1, 10, 100, 1'000, 10'000, 100'000, 1'000'000, 10'000'000, 100'000'000, 1'000'000'000};
constexpr double kExactBelow = 9007199254740992.0;  // 2^53

// magnitude * 10^decimals, rounded half to even, for magnitudes below 2^53 and at most 9 decimals:
// the double is an integer of 53 bits over a power of two, so 128 bits hold all of it.
Wide scaled(double magnitude, int decimals) {
  int exponent = 0;
  const auto bits = static_cast<std::uint64_t>(std::ldexp(std::frexp(magnitude, &exponent), 53));
  const Wide whole = Wide{bits} * kTens[static_cast<std::size_t>(decimals)];
  const int shift = 53 - exponent;  // at least 0
  if (shift == 0) return whole;
  if (shift > 100) return 0;  // less than half of the last digit
  const Wide rest = whole & ((Wide{1} << shift) - 1), half = Wide{1} << (shift - 1);
  const Wide down = whole >> shift;
  const bool is_up = rest > half || (rest == half && (down & 1U) != 0);
  return down + (is_up ? 1 : 0);
}

// Numbers that nobody measures: by printf, which this program has anyway.
void append_rare(std::string& out, double value, int decimals) {
  std::array<char, 352> text{};  // 309 digits before the point, 32 after it, sign and point
  const int length = std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
  std::string_view digits(text.data(), static_cast<std::size_t>(length));
  if (digits.front() == '-' && digits.find_first_not_of("-0.") == std::string_view::npos)
    digits.remove_prefix(1);
  out += digits;
}

}  // namespace

// Not std::to_chars, whose tables for fixed precision are 110 kB of the unit's 4 MB.
void append_number(std::string& out, double value, int decimals) {
  if (!std::isfinite(value)) {
    out += "null";
    return;
  }
  const double magnitude = std::abs(value);
  if (magnitude >= kExactBelow || decimals >= static_cast<int>(kTens.size()))
    return append_rare(out, value, decimals);
  const Wide number = scaled(magnitude, decimals);
  const std::uint64_t unit = kTens[static_cast<std::size_t>(decimals)];
  if (value < 0 && number != 0) out += '-';
  append_integer(out, static_cast<std::uint64_t>(number / unit));
  if (decimals == 0) return;
  out += '.';
  auto fraction = static_cast<std::uint64_t>(number % unit);
  const std::size_t end = out.size() + static_cast<std::size_t>(decimals);
  out.resize(end, '0');
  for (std::size_t i = end; fraction != 0; fraction /= 10)
    out[--i] = static_cast<char>('0' + fraction % 10);
}

void append_quoted(std::string& out, std::string_view text) {
  out += '"';
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    if (length == 0) {
      out += "\xEF\xBF\xBD";
      text.remove_prefix(1);
      continue;
    }
    const char c = text.front();
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (static_cast<std::uint8_t>(c) < 0x20) {
      append_control(out, c);
    } else {
      out += text.substr(0, length);
    }
    text.remove_prefix(length);
  }
  out += '"';
}

}  // namespace wagonsight
