#pragma once

#include <charconv>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>

// JSON written by hand: fixed precision and no locale, so that equal values give equal bytes on
// every machine. Each function appends to `out`.
namespace wagonsight {

// `decimals` digits after the point, correctly rounded. Minus zero is written as zero; what is not
// finite has no JSON number and becomes null.
inline void append_number(std::string& out, double value, int decimals) {
  if (!std::isfinite(value)) {
    out += "null";
    return;
  }
  char text[352];  // 309 digits before the point, 32 after it, sign and point
  const auto end =
      std::to_chars(text, text + sizeof text, value, std::chars_format::fixed, decimals).ptr;
  std::string_view digits(text, static_cast<std::size_t>(end - text));
  if (digits.front() == '-' && digits.find_first_not_of("-0.") == std::string_view::npos)
    digits.remove_prefix(1);
  out += digits;
}

template <class Integer>
void append_integer(std::string& out, Integer value) {
  char text[24];
  const auto end = std::to_chars(text, text + sizeof text, value).ptr;
  out.append(text, end);
}

// In quotes, with JSON's escapes. Bytes that are not UTF-8 (a name that was cut within a character)
// become U+FFFD, so the result is always valid JSON.
void append_quoted(std::string& out, std::string_view text);

}  // namespace wagonsight
