#include "unit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "common/pipeline_options.h"
#include "devices.h"
#include "linux/files.h"
#include "pipeline/place_on_floor.h"
#include "pipeline/stereo_lane.h"
#include "recorded_sensor.h"
#include "recording/sample_images.h"
#include "rig/blob.h"
#include "simulated_wagon.h"

namespace wagonsight {
namespace {

// Well within the time in which the unit says that it learns.
constexpr double kFirstBackgroundMax_s = 1.0;

// What the settings ask for, gathered step by step; each step says what it lacks.
class Assembly {
 public:
  Assembly(Unit& unit, HostTime start) : unit_(unit), start_(start) {}

  Result<void> open_sources(const std::string& rig_path) {
    if (auto opened = open_scene(); !opened) return opened;
    if (auto opened = open_recordings(); !opened) return opened;
    if (!scene_ && recordings_.empty() && !has_devices())
      return fail("settings: no sensor is named; add [[sensor]] or [demo]");
    return find_rig(rig_path.empty() ? unit_.settings.rig.blob : rig_path);
  }

  Result<void> choose_sensors();
  Result<void> find_wagon();
  Result<void> find_floor_in_recording();
  Result<void> make_pipeline();
  Result<void> connect_sources();

 private:
  bool has_devices() const;
  Result<void> open_scene();
  Result<void> open_recordings();
  Result<void> find_rig(const std::string& blob_path);
  Result<void> connect_devices();
  Result<void> take_blob(const std::string& path);
  void take_rig(const Rig& rig, const std::array<RayTable, kSensorsMax>& rays);

  struct Recording {
    std::string path;
    std::unique_ptr<RecordedSensor> sensor;
  };
  Unit& unit_;
  HostTime start_;
  std::optional<SimulatedWagon> scene_;
  std::vector<Recording> recordings_;
  bool is_room_found_ = false;  // in a recording, by nobody's choice
};

bool Assembly::has_devices() const {
  const auto& sensors = unit_.settings.sensors;
  return std::any_of(sensors.begin(), sensors.end(), [](const SensorSettings& sensor) {
    return sensor.source == SensorSource::kDevice;
  });
}

Result<void> Assembly::open_scene() {
  const DemoSettings& demo = unit_.settings.demo;
  if (demo.scene.empty()) return {};
  if (demo.speed != 1.0)
    return fail("settings: demo.speed: the daemon runs at life's speed only; leave it at 1");
  auto scene = SimulatedWagon::open(demo.scene, demo.seed);
  if (!scene) return tl::unexpected(scene.error());
  scene_ = std::move(*scene);
  unit_.simulated = true;
  return {};
}

Result<void> Assembly::open_recordings() {
  for (const SensorSettings& sensor : unit_.settings.sensors) {
    if (sensor.source != SensorSource::kRecording) continue;
    const auto same = [&](const Recording& r) { return r.path == sensor.file; };
    if (std::any_of(recordings_.begin(), recordings_.end(), same)) continue;
    auto opened = RecordedSensor::open(sensor.file);
    if (!opened) return tl::unexpected(opened.error());
    if (sensor.loop) {
      (*opened)->loop();
      unit_.remarks.push_back(fmt::format("{} is played again and again.", sensor.file));
    }
    recordings_.push_back({sensor.file, std::move(*opened)});
  }
  return {};
}

void Assembly::take_rig(const Rig& rig, const std::array<RayTable, kSensorsMax>& rays) {
  unit_.rig = rig;
  unit_.rays = rays;
}

Result<void> Assembly::take_blob(const std::string& path) {
  std::optional<RigBlob> blob;  // of the file that is taken; its sums are most of a start's work
  const auto take = [&](std::span<const std::byte> bytes) -> Result<void> {
    auto opened = open_blob(bytes);
    if (!opened) return tl::unexpected(opened.error());
    blob = std::move(*opened);
    return {};
  };
  auto file = open_file_or_previous(path, take);
  if (!file) return tl::unexpected(file.error());
  if (!file->refusal.empty())
    unit_.remarks.push_back(fmt::format("{}; {} is used instead.", file->refusal, file->path));
  unit_.blob_file = std::move(*file);
  take_rig(blob->rig, blob->rays);
  unit_.blob_sha256 = blob->sha256;
  const std::string name = path.substr(path.find_last_of('/') + 1);
  unit_.calibration.source = std::string_view(name);
  unit_.calibration.present = true;
  return {};
}

Result<void> Assembly::find_rig(const std::string& blob_path) {
  if (!blob_path.empty()) {
    if (auto taken = take_blob(blob_path); !taken) return taken;
    for (Recording& recording : recordings_) recording.sensor->drop_blob();
  } else if (scene_) {
    take_rig(scene_->rig(), {});
    unit_.calibration.present = true;
    unit_.calibration.source = "simulated";
  } else if (recordings_.empty()) {
    return fail("settings: rig.blob: is missing; name the calibration of the sensors");
  } else {
    const RecordingReader& reader = recordings_.front().sensor->reader();
    take_rig(reader.rig(), reader.rays());
    unit_.calibration.present = reader.has_blob();
    unit_.calibration.source = reader.has_blob() ? "in the recording" : "none";
  }
  CalibrationStatus& calibration = unit_.calibration;
  calibration.created_unix = static_cast<double>(unit_.rig.provenance.created_unix);
  calibration.has_georeference = unit_.rig.georeference.present;
  calibration.georeference_sigma_m =
      std::sqrt(unit_.rig.georeference.covariance.diagonal().segment<3>(3).mean());
  return {};
}

// Only the sensors that the settings name, in the settings' order; all when they name none.
Result<void> Assembly::choose_sensors() {
  if (unit_.settings.sensors.empty()) return {};
  const Rig all = unit_.rig;
  const auto all_rays = unit_.rays;
  unit_.rig.sensors.clear();
  unit_.rays = {};
  for (const SensorSettings& wanted : unit_.settings.sensors) {
    const int index = find_sensor(all, wanted.name);
    if (index < 0)
      return fail(
          fmt::format("settings: sensor {}: is not in the calibration; calibrate it or "
                      "remove it from the settings",
                      wanted.name.view()));
    RigSensor sensor = all.sensors[static_cast<std::size_t>(index)];
    if (wanted.trim_m) {
      sensor.trim_near = (*wanted.trim_m)[0];
      sensor.trim_far = (*wanted.trim_m)[1];
    }
    unit_.rays[unit_.rig.sensors.size()] = all_rays[static_cast<std::size_t>(index)];
    unit_.rig.sensors.push_back(sensor);
  }
  return {};
}

Result<void> Assembly::find_wagon() {
  const auto& sensors = unit_.rig.sensors;
  const bool has_poses = std::all_of(sensors.begin(), sensors.end(),
                                     [](const RigSensor& sensor) { return sensor.has_pose; });
  if (!has_poses && !unit_.settings.wagon && !recordings_.empty() && !scene_)
    return find_floor_in_recording();
  if (unit_.settings.wagon) {
    unit_.wagon = *unit_.settings.wagon;
  } else if (scene_) {
    unit_.wagon = scene_->wagon();
  } else {
    return fail("settings: [wagon]: is missing; state the room that the sensors watch");
  }
  for (const RigSensor& sensor : sensors)
    if (!sensor.has_pose)
      return fail(
          fmt::format("sensor {}: its pose in the wagon is not known: name a calibration blob with "
                      "--rig, or import the recording with [pose] in its camera file; with one "
                      "sensor and no [wagon] in the settings, the floor is looked for",
                      sensor.name.view()));
  return {};
}

// A single sensor of unknown pose stands on the floor that its recording shows.
Result<void> Assembly::find_floor_in_recording() {
  if (unit_.rig.sensors.size() > 1)
    return fail(fmt::format(
        "the poses of {} sensors are not known: name a calibration blob with --rig, or one of them "
        "in [[sensor]] of the settings",
        unit_.rig.sensors.size()));
  RigSensor& sensor = unit_.rig.sensors[0];
  const std::string& path = recordings_.front().path;
  // Another reader, so that playing begins at the beginning.
  const auto file = MappedFile::open(path, MappedFile::Pages::kOnDemand);
  if (!file) return tl::unexpected(file.error());
  const auto reader = RecordingReader::open(file->bytes(), DamagePolicy::kSkip);
  if (!reader) return fail(fmt::format("{}: {}", path, reader.error().message));
  if (auto taken = (*reader)->take_only(sensor.name.view()); !taken)
    return fail(fmt::format("{} {}", path, taken.error().message));
  const auto images = sample_images(**reader);
  if (!images) return fail(fmt::format("{}: {}", path, images.error().message));
  if (auto placed = place_on_floor(images->views(), (*reader)->rays()[0], sensor, unit_.wagon);
      !placed)
    return fail(fmt::format("{}: {}", path, placed.error().message));
  is_room_found_ = true;
  unit_.remarks.push_back(
      fmt::format("The pose of {} is not calibrated; the floor was found {:.2f} m below it.",
                  sensor.name.view(), sensor.X_WS.position.z()));
  return {};
}

Result<void> Assembly::make_pipeline() {
  for (std::size_t i = 0; i < unit_.rig.sensors.size(); ++i) {
    if (!unit_.rays[i].empty()) continue;
    unit_.own_rays.push_back(make_ray_table(unit_.rig.sensors[i].camera));
    unit_.rays[i] = unit_.own_rays.back();
  }
  PipelineOptions options = pipeline_options(unit_.settings.pipeline, unit_.settings.stereo);
  options.first_background_s = std::min(kFirstBackgroundMax_s, 0.5 * options.learning_s);
  options.evidence_nodes = kLiveEvidenceNodesMax;
  unit_.workers = std::make_unique<Workers>(
      suitable_workers(unit_.settings.processing.workers, has_stereo(unit_.rig)));
  options.runner = unit_.workers.get();
  auto pipeline = is_room_found_
                      ? Pipeline::create_fitting(unit_.rig, unit_.rays, unit_.wagon, options)
                      : Pipeline::create(unit_.rig, unit_.rays, unit_.wagon, options);
  if (!pipeline) return tl::unexpected(pipeline.error());
  unit_.pipeline = std::move(*pipeline);
  return {};
}

Result<void> Assembly::connect_sources() {
  const auto wanted_by_settings = [&](std::string_view name, SensorSource source,
                                      std::string_view file) {
    const auto& sensors = unit_.settings.sensors;
    return sensors.empty() ||
           std::any_of(sensors.begin(), sensors.end(), [&](const SensorSettings& s) {
             return s.name == name && s.source == source && s.file == file;
           });
  };
  for (const RigSensor& sensor : unit_.rig.sensors) {
    const auto& camera = sensor.camera;
    const auto pixels =
        static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
    // Two bytes a pixel; a stereo camera delivers two images.
    unit_.slot_bytes =
        std::max(unit_.slot_bytes, pixels * 2 * (sensor.kind == SensorKind::kStereo ? 2 : 1));
  }
  for (std::size_t i = 0; i < unit_.rig.sensors.size() && scene_; ++i) {
    const std::string_view name = unit_.rig.sensors[i].name.view();
    if (!wanted_by_settings(name, SensorSource::kSimulated, "")) continue;
    auto source = scene_->source(name, static_cast<std::uint8_t>(i), start_);
    if (!source) return tl::unexpected(source.error());
    unit_.sources.push_back(std::move(*source));
  }
  for (Recording& recording : recordings_) {
    FrameSource source;
    source.rig_index.fill(FrameSource::kNone);
    const RecordingReader& reader = recording.sensor->reader();
    unit_.slot_bytes = std::max(unit_.slot_bytes, reader.slot_bytes());
    for (std::size_t i = 0; i < reader.rig().sensors.size(); ++i) {
      const std::string_view name = reader.rig().sensors[i].name.view();
      const int index = find_sensor(unit_.rig, name);
      if (index >= 0 && wanted_by_settings(name, SensorSource::kRecording, recording.path))
        source.rig_index[i] = static_cast<std::uint8_t>(index);
    }
    recording.sensor->begin_at(start_);
    source.sensor = std::move(recording.sensor);
    source.is_background_work = true;
    source.allocates = true;
    unit_.sources.push_back(std::move(source));
  }
  return connect_devices();
}

// The rig's sensors are the settings', in their order.
Result<void> Assembly::connect_devices() {
  const auto& sensors = unit_.settings.sensors;
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    if (sensors[i].source != SensorSource::kDevice) continue;
    auto device = open_device(sensors[i], unit_.rig.sensors[i]);
    if (!device) return tl::unexpected(device.error());
    FrameSource source;
    source.rig_index.fill(FrameSource::kNone);
    source.rig_index[0] = static_cast<std::uint8_t>(i);
    source.is_device = true;
    source.sensor = std::move(*device);
    unit_.sources.push_back(std::move(source));
  }
  return {};
}

}  // namespace

Result<Settings> read_settings(const std::string& path, std::string* text_without_secrets) {
  const auto text = read_file(path, kSettingsBytesMax);
  if (!text) return tl::unexpected(text.error());
  if (text_without_secrets != nullptr) *text_without_secrets = without_secrets(*text);
  return parse_settings(*text, path);
}

Result<void> check_named_files(const Settings& settings) {
  if (!settings.rig.blob.empty()) {
    const auto file = MappedFile::open(settings.rig.blob);
    if (!file) return tl::unexpected(file.error());
    if (const auto blob = open_blob(file->bytes()); !blob)
      return fail(fmt::format("{}: {}", settings.rig.blob, blob.error().message));
  }
  for (const SensorSettings& sensor : settings.sensors)
    if (sensor.source == SensorSource::kRecording)
      if (auto opened = RecordedSensor::open(sensor.file); !opened)
        return tl::unexpected(opened.error());
  return {};
}

Result<std::unique_ptr<Unit>> assemble_unit(const std::string& settings_path,
                                            const std::string& rig_path, HostTime start) {
  auto unit = std::make_unique<Unit>();
  auto settings = read_settings(settings_path, &unit->settings_text);
  if (!settings) return tl::unexpected(settings.error());
  unit->settings = std::move(*settings);
  Assembly assembly(*unit, start);
  Result<void> done = assembly.open_sources(rig_path);
  if (done) done = assembly.choose_sensors();
  if (done) done = assembly.find_wagon();
  if (done) done = assembly.make_pipeline();
  if (done) done = assembly.connect_sources();
  if (!done) return tl::unexpected(done.error());
  return unit;
}

}  // namespace wagonsight
