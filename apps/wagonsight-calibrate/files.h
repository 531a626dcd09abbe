#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "base/result.h"

namespace wagonsight {

// The whole file; the Error names it and the system's reason.
Result<std::string> read_text(const std::string& path);
// Replaces the file as a whole: written beside it first, then renamed.
Result<void> write_bytes(const std::string& path, std::span<const std::byte> bytes);
Result<void> write_text(const std::string& path, std::string_view text);

}  // namespace wagonsight
