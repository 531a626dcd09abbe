#pragma once

#include "base/result.h"
#include "geometry/camera.h"
#include "geometry/transform.h"

// The rectified camera that follows from what calibration finds of a pair's two imagers.
namespace wagonsight {

// What a pair becomes. S, the sensor's frame, is the rectified left imager: it stands where the
// left imager stands, its x runs along the baseline.
struct RectifiedPair {
  Camera camera;        // of both rectified images; without distortion
  double baseline = 0;  // metres, > 0
  Rigid X_LS;           // rectified to left camera: a rotation
  Rigid X_RS;           // rectified to right camera: its rotation, and the right camera's place
};

// `X_LR` maps from the right camera's frame to the left one's. The rectified plane stands on the
// baseline and faces the mean of the two optical axes (Bouguet's choice: either image turns as
// little as possible). `zoom` is of the focal length; below 1 keeps more of the corners. An Error
// when the sizes differ or exceed kImagePixelsMax, or the right camera is not to the right of the
// left.
Result<RectifiedPair> rectified_pair(const Camera& left, const Camera& right, const Rigid& X_LR,
                                     double zoom = 1.0);

}  // namespace wagonsight
