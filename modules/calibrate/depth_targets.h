#pragma once

#include "base/result.h"
#include "calibrate/georeference.h"
#include "calibrate/solution.h"
#include "frame/image.h"

namespace wagonsight {

// A target's ball as a Kinect's depth shows it.
struct DepthTarget {
  Target::Sphere sphere;
  int readings = 0;
};

// Fits a sphere of `radius_m` to the depth image that was taken together with `sighting`, an image
// of the target's ball. The ball is looked for where the sighting's outline (its size says how far
// away), or else the rays of all sightings, place it. The sphere's sigma holds the readings' noise
// and what the depth camera's own calibration is uncertain by. The Error says why there is none:
// no calibrated depth camera, an image of another size, no reading, no ball, one of another size,
// or another ball than the one that was clicked. Allocates.
Result<DepthTarget> sphere_in_depth(const Solution& solution, const Target& target,
                                    const Target::Sighting& sighting, const DepthImage& image,
                                    double radius_m);

}  // namespace wagonsight
