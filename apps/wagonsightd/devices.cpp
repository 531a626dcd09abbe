#include "devices.h"

#include <fmt/format.h>

#include "kinect/depth_assembly.h"
#include "kinect/kinect_sensor.h"

namespace wagonsight {

Result<std::unique_ptr<Sensor>> open_device(const SensorSettings& settings,
                                            const RigSensor& calibrated) {
  const std::string name(settings.name.view());
  if (settings.kind != "kinect")
    return fail(
        fmt::format("settings: sensor {}: only a Kinect can be a device in this version; "
                    "play a recording of it instead",
                    name));
  if (calibrated.kind != SensorKind::kKinect || calibrated.camera.width != kKinectWidth ||
      calibrated.camera.height != kKinectHeight)
    return fail(
        fmt::format("settings: sensor {}: is a Kinect, but was calibrated as a {} of {} x "
                    "{} pixels; calibrate it anew",
                    name, calibrated.kind == SensorKind::kKinect ? "Kinect" : "stereo pair",
                    calibrated.camera.width, calibrated.camera.height));
  return std::make_unique<KinectSensor>(KinectOptions{name, settings.device, 0});
}

}  // namespace wagonsight
