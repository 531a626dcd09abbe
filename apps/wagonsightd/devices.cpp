#include "devices.h"

#include <fmt/format.h>

#include "iidc/fire_nodes.h"
#include "iidc/iidc_sensor.h"
#include "iidc/trigger_line.h"
#include "kinect/depth_assembly.h"
#include "kinect/kinect_sensor.h"

namespace wagonsight {
namespace {

const char* kind_of(SensorKind kind) {
  return kind == SensorKind::kKinect ? "Kinect" : "stereo pair";
}

IidcTrigger trigger_of(const SensorSettings& settings) {
  if (settings.trigger == "external") return IidcTrigger::kExternal;
  return settings.trigger == "together" ? IidcTrigger::kSoftware : IidcTrigger::kFree;
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
  options.trigger = trigger_of(settings);
  return std::make_unique<IidcSensor>(std::move(options));
}

std::unique_ptr<PulseSource> open_trigger(const std::vector<SensorSettings>& sensors) {
  TriggerLineOptions options;
  options.plan.lead = std::chrono::milliseconds(1);  // half the shutter that cameras begin with
  for (const SensorSettings& sensor : sensors)
    if (sensor.source == SensorSource::kDevice && sensor.kind == "stereo" &&
        trigger_of(sensor) == IidcTrigger::kSoftware)
      options.guids.push_back(parse_guid(sensor.device));
  if (options.guids.empty()) return nullptr;
  return std::make_unique<TriggerLine>(std::move(options));
}

}  // namespace wagonsight
