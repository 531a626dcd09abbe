#pragma once

#include "geometry/camera.h"

namespace wagonsight::testing {

// The pinhole of a real Kinect, as published; its lens is the test's.
inline Camera kinect_camera(const std::array<double, 5>& distortion = {}) {
  Camera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = 525.87;
  camera.fy = 527.81;
  camera.cx = 306.72;
  camera.cy = 267.07;
  camera.distortion = distortion;
  return camera;
}

}  // namespace wagonsight::testing
