#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <optional>

#include "cloud_files.h"
#include "commands.h"
#include "pipeline/stereo_lane.h"
#include "recording_file.h"
#include "stereo/stereo_to_depth.h"

namespace wagonsight {
namespace {

struct ExportOptions {
  std::string recording, sensor, out;
  double time = 0;
};

// The frame of one sensor that is nearest to the wanted instant.
struct Nearest {
  bool found = false;
  FrameSlot slot;  // its bytes are these
  std::vector<std::byte> bytes;
};

// How far from the wanted time a frame may be: three of its periods, but at least half a second.
Duration reach_of(const RigSensor& sensor) {
  return std::max(from_seconds(0.5), from_seconds(3 / sensor.rate_hz));
}

Result<std::vector<Nearest>> find_nearest(RecordingReader& reader, HostTime wanted) {
  const Rig& rig = reader.rig();
  Duration reach{};
  for (const RigSensor& sensor : rig.sensors) reach = std::max(reach, reach_of(sensor));
  // Frames are in the order of their arrival, which trails the instant by well under a second.
  constexpr Duration kLatencyMax = std::chrono::seconds(1);
  std::vector<Nearest> nearest(rig.sensors.size());
  std::vector<std::byte> memory(reader.slot_bytes());
  FrameSlot slot;
  slot.bytes = memory;
  reader.seek(wanted - reach);
  while (true) {
    const auto more = reader.next(slot);
    if (!more) return tl::unexpected(more.error());
    if (!*more || slot.arrival > wanted + reach + kLatencyMax) return nearest;
    Nearest& best = nearest[slot.sensor_index];
    const Duration off = std::chrono::abs(slot.instant - wanted);
    const RigSensor& sensor = rig.sensors[slot.sensor_index];
    const bool is_pair =
        sensor.kind == SensorKind::kStereo &&
        (slot.format == PixelFormat::kGray8 || slot.format == PixelFormat::kGray16);
    const bool is_of_use = (slot.format == PixelFormat::kDepth16 || is_pair) && !slot.damaged;
    if (!is_of_use || off > reach_of(sensor)) continue;
    if (best.found && off >= std::chrono::abs(best.slot.instant - wanted)) continue;
    best.found = true;
    best.slot = slot;
    best.bytes.assign(slot.bytes.begin(), slot.bytes.end());
    best.slot.bytes = best.bytes;
  }
}

// Millimetres, a pixel each: as they were taken, or the whole pair matched as the unit would by
// default.
Result<std::vector<std::uint16_t>> depth_of(const RigSensor& sensor, const Nearest& frame) {
  if (frame.slot.format == PixelFormat::kDepth16) {
    const auto pixels = frame.slot.depth_pixels();
    return std::vector<std::uint16_t>(pixels.begin(), pixels.end());
  }
  auto rectification = rectification_of(sensor);
  if (!rectification) return tl::unexpected(rectification.error());
  const StereoToDepthOptions options;
  const auto workspace = StereoWorkspace::create(rectification->camera.width,
                                                 rectification->camera.height, options.matcher);
  if (!workspace) return tl::unexpected(workspace.error());
  StereoToDepth stereo(std::move(*rectification), options);
  const DepthImage depth = stereo.convert(frame.slot, true, {}, **workspace);
  if (depth.pixels == nullptr)
    return fail(fmt::format("sensor {}: its pair is too dark or too bright to be matched",
                            sensor.name.view()));
  return std::vector<std::uint16_t>(depth.pixels, depth.pixels + depth.pixel_count());
}

// One point a pixel, in W when the pose is known, else in S; not a number without a reading.
void append_points(const RigSensor& sensor, RayTable rays, std::span<const std::uint16_t> depth,
                   std::vector<CloudPoint>& points) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (depth[i] == 0 || rays[i].x == kNoRay) {
      points.push_back({kNone, kNone, kNone});
      continue;
    }
    const double z = sensor.depth_scale * 1e-3 * depth[i] + sensor.depth_offset;
    Eigen::Vector3d p(z * rays[i].x * static_cast<double>(kRayScale),
                      z * rays[i].y * static_cast<double>(kRayScale), z);
    if (sensor.has_pose) p = sensor.X_WS * p;
    points.push_back(
        {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())});
  }
}

Result<void> check_out(const std::string& path) {
  const std::string extension = std::filesystem::path(path).extension().string();
  if (extension == ".ply" || extension == ".pcd") return {};
  return fail(fmt::format("{} ends neither in .ply nor in .pcd, so its form is not known", path));
}

Result<void> write_cloud(const ExportOptions& options, std::vector<CloudPoint> points,
                         const RigSensor* only) {
  // A PCD of one sensor stays organised; everything else holds the points that are there.
  const bool is_pcd = std::filesystem::path(options.out).extension() == ".pcd";
  if (is_pcd && only != nullptr)
    return write_pcd(options.out, points, static_cast<std::size_t>(only->camera.width),
                     static_cast<std::size_t>(only->camera.height));
  std::erase_if(points, [](const CloudPoint& point) { return std::isnan(point[0]); });
  return is_pcd ? write_pcd(options.out, points, points.size(), 1) : write_ply(options.out, points);
}

Result<void> export_cloud(const ExportOptions& options) {
  if (auto good = check_out(options.out); !good) return good;
  auto recording = open_recording(options.recording, DamagePolicy::kStop);
  if (!recording) return tl::unexpected(recording.error());
  RecordingReader& reader = *recording->reader;
  const Rig& rig = reader.rig();
  std::vector<std::size_t> chosen;
  for (std::size_t i = 0; i < rig.sensors.size(); ++i)
    if (options.sensor.empty() || rig.sensors[i].name == options.sensor) chosen.push_back(i);
  if (chosen.empty()) {
    std::string names;
    for (const RigSensor& sensor : rig.sensors)
      names += (names.empty() ? "" : ", ") + std::string(sensor.name.view());
    return fail(
        fmt::format("{} has no sensor {}; it has {}", options.recording, options.sensor, names));
  }
  const auto nearest = find_nearest(reader, reader.start() + from_seconds(options.time));
  if (!nearest) return fail(fmt::format("{} {}", options.recording, nearest.error().message));
  std::vector<CloudPoint> points;
  std::string told;
  for (const std::size_t i : chosen) {
    const RigSensor& sensor = rig.sensors[i];
    const Nearest& frame = (*nearest)[i];
    if (!frame.found) continue;
    const auto depth = depth_of(sensor, frame);
    if (!depth && chosen.size() > 1) continue;
    if (!depth) return fail(fmt::format("{}: {}", options.recording, depth.error().message));
    std::vector<PixelRay> own_rays;  // a rectified camera has none in the blob
    if (reader.rays()[i].empty()) own_rays = make_ray_table(sensor.camera);
    const RayTable rays = own_rays.empty() ? reader.rays()[i] : RayTable(own_rays);
    if (rays.size() != depth->size()) continue;
    if (chosen.size() > 1 && !sensor.has_pose)
      return fail(
          fmt::format("{}: sensor {} has no pose, so its points cannot be put together with "
                      "others; choose one with --sensor",
                      options.recording, sensor.name.view()));
    append_points(sensor, rays, *depth, points);
    told += fmt::format(", {} at {:.3f} s in {}", sensor.name.view(),
                        to_seconds(frame.slot.instant - reader.start()),
                        sensor.has_pose ? "W" : "its own frame");
  }
  if (told.empty())
    return fail(
        fmt::format("{} has no depth frame near {} s; `wagonsight inspect` tells how long "
                    "it is",
                    options.recording, options.time));
  const RigSensor* only = chosen.size() == 1 ? &rig.sensors[chosen[0]] : nullptr;
  if (auto done = write_cloud(options, std::move(points), only); !done) return done;
  fmt::print("{}: metres{}\n", options.out, told);
  return {};
}

}  // namespace

void add_export(CommandLine& line) {
  auto options = std::make_shared<ExportOptions>();
  CLI::App* command =
      line.app.add_subcommand("export", "Write one instant of a recording as a point cloud");
  command->add_option("recording", options->recording, "The recording (MCAP)")->required();
  command->add_option("--time", options->time, "Seconds since the recording's start")->required();
  command->add_option("--sensor", options->sensor, "One sensor only (default: all together)");
  command
      ->add_option("--out", options->out,
                   "CLOUD.ply or CLOUD.pcd; in W (metres) where the pose is known")
      ->required();
  command->callback([&line, options] { line.run = [options] { return export_cloud(*options); }; });
}

}  // namespace wagonsight
