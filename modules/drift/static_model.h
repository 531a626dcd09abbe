#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/result.h"
#include "drift/depth_grid.h"
#include "rig/rig.h"

namespace wagonsight {

// What the sensors saw of the empty wagon on the day of calibration: a depth a cell, 0 where
// nothing static is known. Kept in a file beside the calibration blob and bound to it.
struct StaticModel {
  struct View {
    Name sensor;
    DepthGrid grid;
    std::vector<float> depth_m;  // by cell; empty: this sensor's is not known
  };
  std::array<std::uint8_t, 32> blob_sha256{};  // of the calibration it belongs to
  std::vector<View> views;
};

// Little-endian: "WSSTATIC", version, the blob's sum, the views (depth in tenths of a millimetre),
// CRC-32C of all before it. Both allocate. The Error of parse says what is wrong with the bytes.
std::vector<std::byte> format_static_model(const StaticModel& model);
Result<StaticModel> parse_static_model(std::span<const std::byte> bytes);

}  // namespace wagonsight
