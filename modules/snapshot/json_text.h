#pragma once

#include <charconv>
#include <cstddef>
#include <string>
#include <string_view>

// JSON written by hand: fixed precision and no locale, so that equal values give equal bytes on
// every machine. Each function appends to `out`.
namespace wagonsight {

// `decimals` digits after the point, correctly rounded (half to even). Minus zero is written as
// zero; what is not finite has no JSON number and becomes null.
void append_number(std::string& out, double value, int decimals);

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
