#include <fmt/format.h>

#include "devices.h"

namespace wagonsight {

Result<std::unique_ptr<Sensor>> open_device(const SensorSettings& settings,
                                            const RigSensor& /*calibrated*/) {
  return fail(
      fmt::format("settings: sensor {}: this build drives no devices; use one that does, or "
                  "a recording",
                  settings.name.view()));
}

std::unique_ptr<PulseSource> open_trigger(const std::vector<SensorSettings>& /*sensors*/) {
  return nullptr;
}

}  // namespace wagonsight
