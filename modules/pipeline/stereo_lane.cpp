#include "pipeline/stereo_lane.h"

#include <algorithm>

#include "foreground/mask_rays.h"

namespace wagonsight {

bool has_stereo(const Rig& rig) {
  return std::any_of(rig.sensors.begin(), rig.sensors.end(),
                     [](const RigSensor& sensor) { return sensor.kind == SensorKind::kStereo; });
}

std::vector<std::uint64_t> exposure_mask(const RigSensor& sensor, RayTable rays,
                                         const Wagon& wagon) {
  std::vector<std::uint64_t> mask = rays_into_masks(sensor, rays, wagon);
  for (std::uint64_t& word : mask) word = ~word;
  return mask;
}

}  // namespace wagonsight
