#include "replay_setup.h"

#include <fmt/format.h>

#include <algorithm>

#include "common/pipeline_options.h"
#include "pipeline/place_on_floor.h"
#include "recording/sample_images.h"
#include "rig/blob.h"
#include "settings/settings.h"
#include "simulate/room.h"
#include "simulate/scene.h"
#include "simulated_recording.h"

namespace wagonsight {
namespace {

constexpr double kHeadroom_m = 2.4;  // nobody's head is higher above the floor

// A blob from elsewhere must be of the cameras that were recorded.
Result<void> take_blob(const Rig& recorded, const std::string& path, ReplaySetup& setup) {
  auto file = open_input(path);
  if (!file) return tl::unexpected(file.error());
  setup.blob_file = std::make_unique<MappedFile>(std::move(*file));
  const auto blob = open_blob(setup.blob_file->bytes());
  if (!blob) return fail(fmt::format("{}: {}", path, blob.error().message));
  setup.rig = Rig{};
  setup.rig.georeference = blob->rig.georeference;
  setup.rig.provenance = blob->rig.provenance;
  for (const RigSensor& sensor : recorded.sensors) {
    const int index = find_sensor(blob->rig, sensor.name.view());
    if (index < 0)
      return fail(
          fmt::format("{} has no sensor {}, which the recording has; give the blob of the "
                      "wagon that was recorded",
                      path, sensor.name.view()));
    const RigSensor& known = blob->rig.sensors[static_cast<std::size_t>(index)];
    if (known.camera.width != sensor.camera.width || known.camera.height != sensor.camera.height)
      return fail(fmt::format("{}: sensor {} has {} x {} pixels and its recorded frames {} x {}",
                              path, sensor.name.view(), known.camera.width, known.camera.height,
                              sensor.camera.width, sensor.camera.height));
    setup.rays[setup.rig.sensors.size()] = blob->rays[static_cast<std::size_t>(index)];
    setup.rig.sensors.push_back(known);
  }
  return {};
}

Result<void> take_scene_text(std::string_view text, const std::string& path, ReplaySetup& setup) {
  const auto scene = parse_scene(text, path);
  if (!scene) return tl::unexpected(scene.error());
  setup.wagon = wagon_of(*scene);
  return {};
}

// True when the settings state the room, themselves or by their scene.
Result<bool> take_settings(const std::string& path, ReplaySetup& setup) {
  const auto file = open_input(path);
  if (!file) return tl::unexpected(file.error());
  const auto settings = parse_settings(file->text(), path);
  if (!settings) return tl::unexpected(settings.error());
  setup.options = pipeline_options(settings->pipeline, settings->stereo);
  setup.capture = settings->capture;
  setup.workers = settings->processing.workers;
  for (const SensorSettings& sensor : settings->sensors) {
    const int index = find_sensor(setup.rig, sensor.name.view());
    if (index < 0 || !sensor.trim_m) continue;
    setup.rig.sensors[static_cast<std::size_t>(index)].trim_near = (*sensor.trim_m)[0];
    setup.rig.sensors[static_cast<std::size_t>(index)].trim_far = (*sensor.trim_m)[1];
  }
  if (settings->wagon) {
    setup.wagon = *settings->wagon;
    return true;
  }
  if (settings->demo.scene.empty()) return false;
  const auto scene = open_input(settings->demo.scene);
  if (!scene) return tl::unexpected(scene.error());
  if (auto taken = take_scene_text(scene->text(), settings->demo.scene, setup); !taken)
    return tl::unexpected(taken.error());
  return true;
}

// A simulated recording carries its scene.
Result<bool> take_scene(const RecordingFile& recording, ReplaySetup& setup) {
  const auto attachment = recording.reader->mcap().find_attachment(kSceneAttachment);
  if (!attachment) return fail(fmt::format("{} {}", recording.path, attachment.error().message));
  if (!attachment->has_value()) return false;
  const auto data = (*attachment)->data;
  if (auto taken = take_scene_text({reinterpret_cast<const char*>(data.data()), data.size()},
                                   recording.path + " (its scene)", setup);
      !taken)
    return tl::unexpected(taken.error());
  return true;
}

std::string names_of(const Rig& rig) {
  std::string names;
  for (const RigSensor& sensor : rig.sensors)
    names += fmt::format("{}{}", names.empty() ? "" : ", ", sensor.name.view());
  return names;
}

Result<void> place_alone(RecordingFile& recording, ReplaySetup& setup) {
  RigSensor& sensor = setup.rig.sensors[0];
  if (setup.rig.sensors.size() > 1)
    return fail(
        fmt::format("{} has several sensors ({}), and their poses are not known: choose one with "
                    "--sensor, or calibrate them and give the blob with --rig",
                    recording.path, names_of(setup.rig)));
  const auto images = sample_images(*recording.reader);
  if (!images) return fail(fmt::format("{} {}", recording.path, images.error().message));
  const std::vector<DepthImage> views = images->views();
  if (views.empty()) return fail(fmt::format("{} holds no frame", recording.path));
  if (auto placed = place_on_floor(views, setup.rays[0], sensor, setup.wagon); placed) {
    setup.floor_found =
        fmt::format(", floor found {:.2f} m below the sensor", sensor.X_WS.position.z());
    return {};
  }
  if (auto placed = place_level(views, setup.rays[0], sensor, setup.wagon); !placed)
    return fail(fmt::format("{}: {}", recording.path, placed.error().message));
  setup.remark = fmt::format(
      "no floor is seen: it is assumed {:.2f} m below the sensor, so heights are rough; give the "
      "pose in the camera file ([pose] position and rotation)",
      sensor.X_WS.position.z());
  return {};
}

// What the sensors can see, above the floor: for recordings with poses and no stated room.
Bounds seen_by(const Rig& rig) {
  Bounds seen;
  seen.min.setConstant(1e9);
  seen.max.setConstant(-1e9);
  for (const RigSensor& sensor : rig.sensors) {
    const auto include = [&](const Eigen::Vector3d& p_S) {
      const Eigen::Vector3d p_W = sensor.X_WS * p_S;
      seen.min = seen.min.cwiseMin(p_W);
      seen.max = seen.max.cwiseMax(p_W);
    };
    const Camera& camera = sensor.camera;
    include(Eigen::Vector3d::Zero());
    for (const double u : {0.0, static_cast<double>(camera.width)})
      for (const double v : {0.0, static_cast<double>(camera.height)})
        include(sensor.trim_far *
                Eigen::Vector3d((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1));
  }
  seen.min.z() = 0;
  seen.max.z() = kHeadroom_m;
  return seen;
}

}  // namespace

Result<ReplaySetup> set_up_replay(RecordingFile& recording, const std::string& config_path,
                                  const std::string& rig_path) {
  ReplaySetup setup;
  setup.rig = recording.reader->rig();
  setup.rays = recording.reader->rays();
  if (!rig_path.empty())
    if (auto done = take_blob(recording.reader->rig(), rig_path, setup); !done)
      return tl::unexpected(done.error());
  bool has_room = false;
  if (!config_path.empty()) {
    const auto taken = take_settings(config_path, setup);
    if (!taken) return tl::unexpected(taken.error());
    has_room = *taken;
  }
  if (!has_room) {
    const auto taken = take_scene(recording, setup);
    if (!taken) return tl::unexpected(taken.error());
    has_room = *taken;
  }
  setup.had_pose = std::all_of(setup.rig.sensors.begin(), setup.rig.sensors.end(),
                               [](const RigSensor& sensor) { return sensor.has_pose; });
  const auto frames = count_frames(*recording.reader);
  if (!frames) return fail(fmt::format("{} {}", recording.path, frames.error().message));
  setup.frame_count = *frames;
  if (!setup.had_pose) {
    if (auto done = place_alone(recording, setup); !done) return tl::unexpected(done.error());
  } else if (!has_room) {
    setup.wagon.inside = seen_by(setup.rig);
  }
  if (config_path.empty()) setup.options.fps_expected = setup.rig.sensors[0].rate_hz;
  return setup;
}

}  // namespace wagonsight
