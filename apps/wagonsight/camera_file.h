#pragma once

#include <string>
#include <string_view>

#include "base/result.h"
#include "rig/rig.h"

namespace wagonsight {

// What CAMERA.toml says of the one camera of an import.
struct CameraFile {
  RigSensor sensor;
  double depth_unit_m = 0.001;  // metres a unit of the images
};

// `path` is only told in errors: file, line, key, value and the rule that is broken.
Result<CameraFile> parse_camera_file(std::string_view text, const std::string& path);

}  // namespace wagonsight
