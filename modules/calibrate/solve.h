#pragma once

#include "calibrate/solution.h"

namespace wagonsight {

struct SolveOptions {
  double robust_px = 1.0;      // scale of the Cauchy loss of the first adjustment
  double reject_sigmas = 4.5;  // of an imager's noise; a corner beyond is named and left out;
                               // 0: every corner of every view counts, and all imagers weigh alike
  bool hold_out = true;        // estimate the error on corners that were not used
  int iterations_max = 100;
};

// Bundle adjustment (the paper's equation 1) of all imagers and board poses in one frame B, which
// is the board pose seen by most imagers. Start values are found from the views alone: intrinsics
// by Zhang's method where none are given, poses by resection and a walk over the graph of imagers
// that share board poses. Wrong IDs, and boards whose IDs are mirrored, turned or shifted, are
// found and named in Solution::remarks. Deterministic. The Error names what is missing; a rig that
// falls apart is refused with the names of its groups.
Result<Solution> solve(const Observations& observations, const std::vector<SensorSpec>& sensors,
                       const SolveOptions& options = {});

}  // namespace wagonsight
