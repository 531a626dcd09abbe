#pragma once

#include <array>
#include <span>

#include "base/result.h"

namespace wagonsight {

// How far one cloud's points lie from the nearest point of another, metres.
struct SurfaceDistances {
  double mean_m = 0, rms_m = 0, median_m = 0, p95_m = 0, max_m = 0;
};

// A fused cloud against points of the true surface, both in W.
struct SurfaceError {
  SurfaceDistances accuracy;      // from the cloud to the truth: noise, misplaced sensors
  SurfaceDistances completeness;  // from the truth to the cloud: what was not seen
  double covered_share = 0;       // truth points with a cloud point within `covered_m`
};

// The truth must be sampled more densely than the error that is asked for: half its spacing is the
// smallest accuracy that can be measured. An Error when either is empty.
Result<SurfaceError> surface_error(std::span<const std::array<float, 3>> cloud,
                                   std::span<const std::array<float, 3>> truth,
                                   double covered_m = 0.05);

}  // namespace wagonsight
