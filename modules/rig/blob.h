#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/result.h"
#include "rig/ray_table.h"
#include "rig/rig.h"

// The calibration blob: what the daemon needs of a calibration, ready to be used where it lies.
// Little-endian; a header, a table of sections (kind, sensor, offset, length, CRC-32C each, offsets
// aligned to 64), the sections, and a SHA-256 over all that precedes it. Version in the header; a
// reader refuses a newer version by name. The layout, byte by byte, is in README.md.
namespace wagonsight {

inline constexpr std::uint16_t kBlobVersion = 1;

// A blob that was checked. The tables point into `bytes`, which must outlive it (a mapped file).
struct RigBlob {
  Rig rig;
  std::array<RayTable, kSensorsMax> rays{};  // by sensor; empty for rectified stereo
  std::array<std::uint8_t, 32> sha256{};
};

// The bytes of a blob; deterministic. The rig is packed as it is: a rig that check_rig() refuses
// gives a blob that open_blob() refuses. Allocates.
std::vector<std::byte> pack_blob(const Rig& rig);

// Checks every sum, range and size before anything is used. `bytes` must be 4-byte aligned, as mmap
// gives. The Error says which check failed: "too short", "not a calibration blob", "made by a newer
// version", "section k0/rays is damaged", ...
Result<RigBlob> open_blob(std::span<const std::byte> bytes);

}  // namespace wagonsight
