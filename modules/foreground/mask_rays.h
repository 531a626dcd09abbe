#pragma once

#include <cstdint>
#include <vector>

#include "rig/ray_table.h"
#include "rig/rig.h"
#include "wagon/wagon.h"

namespace wagonsight {

// The pixels whose ray meets a mask volume (a window, a screen), or passes it by less than a
// millimetre: a bit a pixel. Allocates.
std::vector<std::uint64_t> rays_into_masks(const RigSensor& sensor, RayTable rays,
                                           const Wagon& wagon);

}  // namespace wagonsight
