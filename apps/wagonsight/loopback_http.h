#pragma once

#include <cstdint>
#include <string>

#include "base/result.h"

namespace wagonsight {

// The body of GET http://127.0.0.1:PORT/PATH, within two seconds. The Error: nobody listens, no
// answer in time, or an answer other than 200 and 503 (which the unit's health is told with, too).
Result<std::string> get_from_loopback(std::uint16_t port, const std::string& path);

}  // namespace wagonsight
