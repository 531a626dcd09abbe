#pragma once

#include <memory>
#include <vector>

#include "capture/sensor.h"
#include "capture/trigger_plan.h"
#include "rig/rig.h"
#include "settings/settings.h"

namespace wagonsight {

// The driver of a sensor whose source is a device; its slots say sensor 0. That the device is not
// there, or not yet, is no Error: the driver waits for it and says so. The Error: such a device
// cannot be what was calibrated, or this build drives none.
Result<std::unique_ptr<Sensor>> open_device(const SensorSettings& settings,
                                            const RigSensor& calibrated);

// What triggers the devices that are to be triggered together; nullptr: there are none.
std::unique_ptr<PulseSource> open_trigger(const std::vector<SensorSettings>& sensors);

}  // namespace wagonsight
