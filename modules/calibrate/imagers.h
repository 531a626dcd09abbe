#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "geometry/camera.h"
#include "geometry/transform.h"
#include "rig/rig.h"

namespace wagonsight {

// The depth camera of a Kinect whose colour or infrared image was calibrated ([sensor.depth]).
struct DepthCameraSpec {
  bool from_infrared = false;  // the depth image is the infrared one's, moved by some pixels
  Camera camera;               // colour only; its intrinsics are taken as they are
  Rigid X_CS;                  // colour only: depth camera S in the colour camera C, to begin with
};

// One sensor of SENSORS.toml. A stereo camera NAME has the imagers NAME.left and NAME.right, which
// share this entry's start values.
struct SensorSpec {
  std::string name;
  SensorKind kind = SensorKind::kKinect;
  int width = 0;
  int height = 0;
  bool fix_intrinsics = false;
  std::optional<Camera> start;   // absent: estimated from the views
  double fixed_sigma_focal = 0;  // relative; what fixed intrinsics are trusted to
  double fixed_sigma_centre_px = 0;
  std::optional<double> baseline_m;      // stereo only: known distance of the imagers ...
  double baseline_sigma_m = 0.0001;      // ... and how well
  std::optional<DepthCameraSpec> depth;  // kinect only
};

// What is solved for: one lens and one image.
struct Imager {
  std::string name;
  int sensor_index = 0;  // into the specs
};

// The Error names file, line, key, value and rule.
Result<std::vector<SensorSpec>> parse_sensors(std::string_view toml, std::string_view file);
std::vector<Imager> imagers_of(const std::vector<SensorSpec>& specs);

}  // namespace wagonsight
