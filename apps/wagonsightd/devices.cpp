#include "devices.h"

#include <fmt/format.h>

#include "iidc/iidc_sensor.h"
#include "kinect/depth_assembly.h"
#include "kinect/kinect_sensor.h"

namespace wagonsight {
namespace {

const char* kind_of(SensorKind kind) {
  return kind == SensorKind::kKinect ? "Kinect" : "stereo pair";
}

}  // namespace

Result<std::unique_ptr<Sensor>> open_device(const SensorSettings& settings,
                                            const RigSensor& calibrated) {
  const std::string name(settings.name.view());
  const auto& camera = calibrated.camera;
  const SensorKind kind = settings.kind == "stereo" ? SensorKind::kStereo : SensorKind::kKinect;
  const bool has_size = kind == SensorKind::kStereo ||
                        (camera.width == kKinectWidth && camera.height == kKinectHeight);
  if (calibrated.kind != kind || !has_size)
    return fail(
        fmt::format("settings: sensor {}: is a {}, but was calibrated as a {} of {} x {} pixels; "
                    "calibrate it anew",
                    name, kind_of(kind), kind_of(calibrated.kind), camera.width, camera.height));
  if (kind == SensorKind::kKinect)
    return std::make_unique<KinectSensor>(KinectOptions{name, settings.device, 0});
  IidcOptions options;
  options.name = name;
  options.device = settings.device;
  options.width = camera.width;
  options.height = camera.height;
  options.trigger = settings.trigger == "external" ? IidcTrigger::kExternal : IidcTrigger::kFree;
  return std::make_unique<IidcSensor>(std::move(options));
}

}  // namespace wagonsight
