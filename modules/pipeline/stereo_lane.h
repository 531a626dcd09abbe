#pragma once

#include <cstdint>
#include <vector>

#include "rig/ray_table.h"
#include "rig/rig.h"
#include "stereo/rectify_sensor.h"
#include "wagon/wagon.h"

namespace wagonsight {

bool has_stereo(const Rig& rig);

// The pixels by which a camera's exposure is judged: a bit a pixel, 1 unless its ray meets a mask
// volume (a window or a screen, which must not decide how bright the inside is). Allocates.
std::vector<std::uint64_t> exposure_mask(const RigSensor& sensor, RayTable rays,
                                         const Wagon& wagon);

}  // namespace wagonsight
