#pragma once

#include <cstdint>
#include <vector>

#include "base/result.h"
#include "rig/ray_table.h"
#include "rig/rig.h"
#include "stereo/rectify.h"
#include "wagon/wagon.h"

namespace wagonsight {

bool has_stereo(const Rig& rig);

// How a stereo camera's pair is resampled: by its lenses; without any its images are taken for
// rectified ones and there are no tables. The Error says that rig and lenses do not fit each other.
// Allocates.
Result<StereoRectification> rectification_of(const RigSensor& sensor);

// The pixels by which a camera's exposure is judged: a bit a pixel, 1 unless its ray meets a mask
// volume (a window or a screen, which must not decide how bright the inside is). Allocates.
std::vector<std::uint64_t> exposure_mask(const RigSensor& sensor, RayTable rays,
                                         const Wagon& wagon);

}  // namespace wagonsight
