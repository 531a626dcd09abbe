#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "base/result.h"

namespace wagonsight {

// The content of one file in a zip archive (stored or deflated, no zip64), its CRC checked. The
// Error says what is wrong with the archive, or that it has no such file.
Result<std::string> read_from_zip(std::span<const std::byte> archive, std::string_view name);

}  // namespace wagonsight
