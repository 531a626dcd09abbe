#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "base/result.h"

namespace wagonsight {

using CloudPoint = std::array<float, 3>;  // metres

// Binary little-endian PLY and binary PCD 0.7, x y z as float.
Result<void> write_ply(const std::string& path, std::span<const CloudPoint> points);
// `width` x `height` organised when height is above 1; their product is the number of points.
Result<void> write_pcd(const std::string& path, std::span<const CloudPoint> points,
                       std::size_t width, std::size_t height);

}  // namespace wagonsight
