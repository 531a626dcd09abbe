#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"
#include "calibrate/imagers.h"
#include "calibrate/solution.h"
#include "rig/rig.h"

// A Kinect is calibrated through its colour or infrared image, but measures with its depth camera.
// Wherever the solved board also stands in a depth image, its plane is known there: that ties the
// depth camera to the imager and corrects its readings.
namespace wagonsight {

// A depth image taken while the board stood in `pose` (a pose of the solution).
struct DepthView {
  std::string imager;
  std::string pose;
  std::string image;  // file, for messages
  int width = 0, height = 0;
  std::vector<std::uint16_t> raw_mm;  // row by row; 0: no reading
};

struct DepthOptions {
  DepthNoise noise;      // of one reading, before correction
  int stride_px = 9;     // a Kinect matches windows of 9 x 9: nearer readings are not independent
  double gate_m = 0.15;  // a reading farther from the board's plane is somebody's hand
  double gate_sigmas = 4;
};

// Estimates, for every imager of `sensors` that has a depth camera and depth views: X_CS (colour),
// or the pixel offset (infrared), and the correction of its readings; by Gauss-Newton on the
// distances of readings from the board's planes, each plane itself uncertain by the corners that
// placed it, with weak priors (kDepthPrior*) so that too few tilted boards widen the covariance and
// are remarked instead of failing. Writes ImagerSolution::depth and remarks. The Error names a
// depth image whose size is not the camera's, or an unknown imager or pose.
Result<void> calibrate_depth(std::span<const DepthView> views,
                             const std::vector<SensorSpec>& sensors, Solution& solution,
                             const DepthOptions& options = {});

inline constexpr double kDepthPriorRotation_rad = 0.05;
inline constexpr double kDepthPriorPosition_m = 0.01;
inline constexpr double kDepthPriorScale = 0.2;
inline constexpr double kDepthPriorOffset_m = 0.02;
inline constexpr double kDepthPriorPixels = 8;

// What the Kinects' depth says about the board: they measure in metres of their own, good to a
// percent. Fills Solution::scale_check, and remarks on a square that is off by more than 2% with
// the size that the depth says. Does nothing without a depth calibration.
void check_scale(Solution& solution);

}  // namespace wagonsight
