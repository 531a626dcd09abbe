#pragma once

#include "capture/frame_grouping.h"
#include "rig/rig.h"
#include "settings/settings.h"

namespace wagonsight {

// How frames are grouped by a unit's settings and its blob, for the daemon and for a replay alike.
FrameSetOptions grouping_options(const CaptureSettings& settings, const Rig& rig);

}  // namespace wagonsight
