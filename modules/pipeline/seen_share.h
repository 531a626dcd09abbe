#pragma once

#include <array>

#include "rig/rig.h"
#include "snapshot/snapshot.h"

namespace wagonsight {

// How much of a person one view saw, 0..1: the part of the box's outline in the image that the
// person's own pixels span (`image_box`: u_min, v_min, u_max, v_max, inclusive). The outline is the
// upright rectangle about the projected corners of `box` (W); what lies beyond the image's border
// was not seen. 0 where the box is behind the sensor. Does not allocate.
float seen_share(const Box& box, const RigSensor& sensor, const std::array<int, 4>& image_box);

}  // namespace wagonsight
