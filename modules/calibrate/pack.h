#pragma once

#include "calibrate/solution.h"
#include "rig/rig.h"

namespace wagonsight {

// What the unit needs of a solution. The similarity's scale belongs to the board's stated size: it
// scales the translations X_BS and baselines, never a depth reading, so X_WS is rigid:
//   X_WS = (R_WB, t_WB) * (R_BS, scale * t_BS).
// Without a georeference W is B turned so that z is up. A stereo camera becomes one sensor whose S
// is the rectified left imager. The covariance of X_WS joins those of X_BS and of the georeference.
Result<Rig> to_rig(const Solution& solution);

}  // namespace wagonsight
