#pragma once

#include <sodium/crypto_hash_sha256.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "base/crc32c.h"

// Gives a changed calibration blob sums that match again, so that a test or a fuzzer reaches the
// checks behind the sums. Works on the layout in modules/rig/README.md, independently of the code.
namespace wagonsight::test {

inline void reseal_blob(std::span<std::byte> blob) {
  constexpr std::size_t kHeader = 64, kEntry = 32, kDigest = 32;
  if (blob.size() < kHeader + kDigest) return;
  std::uint32_t section_count = 0;
  std::memcpy(&section_count, blob.data() + 12, sizeof section_count);
  for (std::uint32_t i = 0; i < section_count; ++i) {
    const std::size_t entry = kHeader + i * kEntry;
    if (entry + kEntry > blob.size()) break;
    std::uint64_t offset = 0, length = 0;
    std::memcpy(&offset, blob.data() + entry + 8, sizeof offset);
    std::memcpy(&length, blob.data() + entry + 16, sizeof length);
    if (offset > blob.size() || length > blob.size() - offset) continue;
    const std::uint32_t crc = crc32c(blob.subspan(offset, length));
    std::memcpy(blob.data() + entry + 4, &crc, sizeof crc);
  }
  crypto_hash_sha256(reinterpret_cast<unsigned char*>(blob.data() + blob.size() - kDigest),
                     reinterpret_cast<const unsigned char*>(blob.data()), blob.size() - kDigest);
}

}  // namespace wagonsight::test
