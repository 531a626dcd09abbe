#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "base/result.h"

namespace wagonsight {

// A 16-bit grey PNG, packed fast rather than small.
Result<void> write_png16(const std::string& path, std::span<const std::uint16_t> pixels, int width,
                         int height);

}  // namespace wagonsight
