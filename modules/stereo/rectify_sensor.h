#pragma once

#include "base/result.h"
#include "rig/rig.h"
#include "stereo/rectify.h"

namespace wagonsight {

// How a stereo camera's pair is resampled: by its lenses; without any its images are taken for
// rectified ones and there are no tables. The Error says that rig and lenses do not fit each other.
// Allocates.
Result<StereoRectification> rectification_of(const RigSensor& sensor);

}  // namespace wagonsight
