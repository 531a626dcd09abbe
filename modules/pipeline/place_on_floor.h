#pragma once

#include <span>

#include "base/result.h"
#include "frame/image.h"
#include "rig/ray_table.h"
#include "rig/rig.h"
#include "wagon/wagon.h"

namespace wagonsight {

// Gives a single sensor that came without a pose its place above the floor it sees: W stands on the
// floor straight below it, z up, the sensor looks along +x. Sets sensor.X_WS, sensor.has_pose and,
// when it is empty, wagon.inside: what the sensor can see within its trims, up to 2.4 m.
//
// `images` are some frames of the recording (a dozen, spread over it, are plenty; what moves in
// them does no harm); `rays` one a pixel. The Error says that no floor was found and what to do.
// Allocates; for start-up only.
Result<void> place_on_floor(std::span<const DepthImage> images, RayTable rays, RigSensor& sensor,
                            Wagon& wagon);

// The same where no floor is seen: what is upright is told from the ceiling, or else taken from the
// image, and the floor is assumed under the lowest that is seen, or as far below the ceiling or the
// sensor as is usual. The Error says that there are next to no readings.
Result<void> place_level(std::span<const DepthImage> images, RayTable rays, RigSensor& sensor,
                         Wagon& wagon);

}  // namespace wagonsight
