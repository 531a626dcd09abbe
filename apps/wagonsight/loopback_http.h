#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "base/result.h"

namespace wagonsight {

// The body of GET http://127.0.0.1:PORT/PATH, within two seconds. The Error: nobody listens, no
// answer in time, or an answer other than 200 and 503 (which the unit's health is told with, too).
Result<std::string> get_from_loopback(std::uint16_t port, const std::string& path);

// A unit elsewhere, by its numeric IPv4 address.
struct UnitAddress {
  std::string text;  // as it was given
  std::uint32_t host = 0;
  std::uint16_t port = 8080;
};
Result<UnitAddress> parse_unit_address(std::string_view text);

struct UnitAnswer {
  int status = 0;
  std::string body;
};
// One request with a token, whatever is answered. The Error begins with "no " when there was no
// answer, so that it is worth another try.
Result<UnitAnswer> unit_request(const UnitAddress& to, std::string_view method,
                                std::string_view path, std::string_view token,
                                std::span<const std::byte> body = {});

}  // namespace wagonsight
