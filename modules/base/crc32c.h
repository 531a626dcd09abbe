#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace wagonsight {

// CRC-32C (Castagnoli, polynomial 0x1EDC6F41 reflected, initial and final XOR all ones), as in
// RFC 3720 appendix B.4. Continue a running sum by passing the previous result as `crc`.
std::uint32_t crc32c(std::span<const std::byte> bytes, std::uint32_t crc = 0);

}  // namespace wagonsight
