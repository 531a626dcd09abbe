#pragma once

#include <algorithm>
#include <charconv>
#include <string>
#include <string_view>

namespace wagonsight {

// The rest of the first line that begins with the key and a space; empty: there is none.
inline std::string line_value(std::string_view text, std::string_view key) {
  while (!text.empty()) {
    const std::string_view line = text.substr(0, text.find('\n'));
    if (line.starts_with(key) && line.size() > key.size() && line[key.size()] == ' ')
      return std::string(line.substr(key.size() + 1));
    text.remove_prefix(std::min(line.size() + 1, text.size()));
  }
  return {};
}

// The number that the text begins with; 0: none.
template <class Number>
Number leading_number(std::string_view text) {
  Number number = 0;
  (void)std::from_chars(text.data(), text.data() + text.size(), number);
  return number;
}

}  // namespace wagonsight
