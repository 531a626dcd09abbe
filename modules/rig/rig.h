#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string_view>

#include "base/capacities.h"
#include "base/fixed_string.h"
#include "base/fixed_vector.h"
#include "base/result.h"
#include "base/time.h"
#include "geometry/camera.h"
#include "geometry/transform.h"

// What calibration knows of the sensors, and nothing of what they see.
namespace wagonsight {

enum class SensorKind : std::uint8_t { kKinect, kStereo };

// Standard deviation of one depth reading at depth z (metres): sigma = a + b z + c z^2, plus the
// quantisation step of a disparity of 1/step pixel: q(z) = z^2 / (focal * baseline * step).
// (Khoshelham and Elberink 2012 for structured light; Gallup et al. 2008 for stereo.)
struct DepthNoise {
  double a = 0.001;
  double b = 0.0;
  double c = 0.0019;
  double quantisation_per_z2 = 0.00285;  // Kinect v1: 1 / (580 px * 0.075 m * 8)

  double sigma(double z) const { return a + b * z + c * z * z; }
  double step(double z) const { return quantisation_per_z2 * z * z; }
};

struct StereoGeometry {  // of a rectified pair; right = left shifted by `baseline` along +x of S
  double baseline = 0;
  // What rectification starts from: the lenses as calibrated, and the right one's frame in the left
  // one's (metres, the length is the baseline). Absent where images come rectified (width 0).
  Camera left, right;
  Rigid X_LR;

  bool has_lenses() const { return left.width > 0; }
};

// How much later a sensor's time stamps are than its light, against the sensor of the rig whose are
// earliest; arrival times cannot tell. Zero: not measured. Recordings keep the raw stamps; it is
// taken off where frames are grouped.
struct StampDelay {
  double delay_s = 0;
  double sigma_s = 0;

  bool is_known() const { return delay_s != 0 || sigma_s != 0; }
};

struct RigSensor {
  Name name;
  SensorKind kind = SensorKind::kKinect;
  Camera camera;         // S: the depth camera; for stereo the rectified left imager
  Rigid X_BS;            // sensor to board, as estimated
  bool has_pose = true;  // false: an import that came without one; the floor is found instead
  Rigid X_WS;            // sensor to world: what the pipeline uses
  DepthNoise noise;
  StereoGeometry stereo;   // kStereo only
  double trim_near = 0.4;  // metres along z; readings outside are dropped
  double trim_far = 6.0;
  double rate_hz = 30;
  double depth_scale = 1.0;   // per-unit depth correction: z = scale * raw + offset
  double depth_offset = 0.0;  // metres
  double rms_px = 0;          // reprojection error of its calibration, 0: unknown
  StampDelay stamp_delay;
  // Covariance of X_WS: rotation vector (rad, in W) then position (m, in W); zero: unknown.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

struct Georeference {  // board to world: the paper's equation 7
  bool present = false;
  Similarity X_WB;
  // rotation vector (3), position (3), scale
  Eigen::Matrix<double, 7, 7> covariance = Eigen::Matrix<double, 7, 7>::Zero();
  double rms_m = 0;
};

struct Provenance {
  FixedString<80> made_by;        // program and version
  std::int64_t created_unix = 0;  // 0: unknown or deliberately left out (reproducible files)
  FixedString<120> note;
};

struct Rig {
  FixedVector<RigSensor, kSensorsMax> sensors;
  Georeference georeference;
  Provenance provenance;
};

// Index of the sensor of that name, or -1.
int find_sensor(const Rig& rig, std::string_view name);

// By sensor index, for FrameSetOptions; zero where none is known.
std::array<Duration, kSensorsMax> stamp_delays(const Rig& rig);

// 1 to 40 letters, digits, _ and -: fit for a file's name, a metric's label and a topic.
bool is_sensor_name(std::string_view name);

// Refuses what no rig can have: values that are not numbers, rotations that are not, images larger
// than kImagePixelsMax, trims the wrong way round, two sensors of one name. The Error names the
// sensor, the field, its value and the rule. Every reader of a Rig from outside calls it.
Result<void> check_rig(const Rig& rig);

}  // namespace wagonsight
