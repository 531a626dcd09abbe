#include <fmt/format.h>

#include "camera_file.h"
#include "commands.h"
#include "depth_folder.h"
#include "files.h"
#include "frame/frame.h"
#include "progress.h"
#include "recording/recording_writer.h"
#include "version.h"

namespace wagonsight {
namespace {

struct ImportOptions {
  std::string depth, camera, out;
};

Result<Rig> rig_of(const CameraFile& camera, const std::string& path) {
  Rig rig;
  rig.sensors.push_back(camera.sensor);
  rig.provenance.made_by = FixedString<80>(kProgramText);
  rig.provenance.note = "import";
  if (auto good = check_rig(rig); !good)
    return fail(fmt::format("{}: {}", path, good.error().message));
  return rig;
}

// Frames are dated by their place in the order: frame i at i / rate.
Result<void> write_frames(DepthFolder& folder, const RigSensor& sensor, RecordingWriter& writer) {
  const Camera& camera = sensor.camera;
  const std::size_t pixels =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  FramePool pool(1, pixels * sizeof(std::uint16_t));
  FrameSlot* slot = pool.acquire();
  slot->width = camera.width;
  slot->height = camera.height;
  Progress progress("frames", folder.frame_count());
  for (std::size_t i = 0; i < folder.frame_count(); ++i) {
    slot->sequence = static_cast<std::uint32_t>(i);
    slot->instant = HostTime{from_seconds(static_cast<double>(i) / sensor.rate_hz)};
    slot->arrival = slot->instant;
    slot->device_ticks = static_cast<std::uint64_t>(slot->instant.time_since_epoch().count());
    if (auto done = folder.read(i, slot->depth_pixels()); !done) return done;
    if (auto done = writer.write(*slot); !done) return done;
    progress.update(i + 1);
  }
  pool.release(slot);
  return {};
}

Result<void> import(const ImportOptions& options) {
  const auto camera_text = open_input(options.camera);
  if (!camera_text) return tl::unexpected(camera_text.error());
  const auto camera = parse_camera_file(camera_text->text(), options.camera);
  if (!camera) return tl::unexpected(camera.error());
  const auto rig = rig_of(*camera, options.camera);
  if (!rig) return tl::unexpected(rig.error());
  auto folder = DepthFolder::open(options.depth, *camera);
  if (!folder) return tl::unexpected(folder.error());

  auto file = OutputFile::create(options.out);
  if (!file) return tl::unexpected(file.error());
  RecordingOptions recording;
  recording.mcap.library = kProgramText;
  recording.provenance = {{"made_by", kProgramText}, {"source", "import"}};
  auto writer = RecordingWriter::create(**file, *rig, recording);
  if (!writer) return tl::unexpected(writer.error());
  if (auto done = write_frames(*folder, camera->sensor, **writer); !done) return done;
  if (auto done = (*writer)->finish(); !done) return done;
  if (auto done = (*file)->close(); !done) return done;

  const McapWriter& mcap = (*writer)->mcap();
  fmt::print("{}: {} frames of {} x {} pixels, {:.1f} s at {} Hz, {:.1f} MB\n", options.out,
             (*writer)->frame_count(), camera->sensor.camera.width, camera->sensor.camera.height,
             static_cast<double>(folder->frame_count()) / camera->sensor.rate_hz,
             camera->sensor.rate_hz, static_cast<double>(mcap.bytes_written()) * 1e-6);
  return {};
}

}  // namespace

void add_import(CommandLine& line) {
  auto options = std::make_shared<ImportOptions>();
  CLI::App* command = line.app.add_subcommand(
      "import", "Make a recording from depth images: 16-bit PNG or PGM, or organised PCD clouds");
  command
      ->add_option("--depth", options->depth,
                   "Folder of the frames, taken in the order of their names")
      ->required();
  command
      ->add_option("--camera", options->camera,
                   "TOML file: name, width, height, fx, fy, cx, cy (0-based pixels), distortion = "
                   "[k1, k2, p1, p2, k3], depth_unit_m, rate_hz, trim_m = [near, far]; and "
                   "optionally [pose] with position and rotation")
      ->required();
  command->add_option("--out", options->out, "The recording (MCAP)")->required();
  command->callback([&line, options] { line.run = [options] { return import(*options); }; });
}

}  // namespace wagonsight
