#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"

namespace wagonsight {

// An organised cloud: one point a pixel, row by row, in the camera's frame (x right, y down,
// z forward, metres); not a number where there is no reading.
struct OrganisedCloud {
  int width = 0, height = 0;
  std::vector<std::array<float, 3>> points;
};

// Reads the Point Cloud Library's PCD 0.7 in its three forms (ascii, binary, binary_compressed).
// `path` is told in errors; a cloud that is not organised is refused. Memory is reused.
Result<void> read_pcd(std::span<const std::byte> file, const std::string& path,
                      OrganisedCloud& cloud);

}  // namespace wagonsight
