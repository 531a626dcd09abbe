#include <fmt/format.h>

#include <memory>

#include "capture/frame_set_builder.h"
#include "commands.h"
#include "files.h"
#include "png_writer.h"
#include "progress.h"
#include "recording/recording_writer.h"
#include "rig/blob.h"
#include "simulate/room.h"
#include "simulate/scene.h"
#include "simulate/simulation.h"
#include "simulated_recording.h"
#include "snapshot/json_lines.h"
#include "stereo/exposure.h"
#include "version.h"

namespace wagonsight {
namespace {

struct SimulateOptions {
  std::string scene, out, truth, rig_out, images;
  double seconds = 0;
  std::uint64_t seed = 1;
};

// Writes the truth of the instants at which a replay will have FrameSets, and of those at which it
// has none because every sensor is silent.
class TruthWriter {
 public:
  TruthWriter(Simulation& simulation, const Rig& rig, FramePool& pool, OutputFile* file)
      : simulation_(simulation), file_(file) {
    std::array<double, kSensorsMax> rates_hz{};
    for (std::size_t i = 0; i < rig.sensors.size(); ++i) rates_hz[i] = rig.sensors[i].rate_hz;
    FrameSetOptions options;
    options.tick_when_silent = true;
    builder_ = std::make_unique<FrameSetBuilder>(
        pool, std::span(rates_hz).first(rig.sensors.size()), options);
  }

  // Takes over the slot.
  Result<void> add(FrameSlot* slot) {
    const HostTime now = slot->arrival;
    if (auto done = tell(now); !done) return done;
    builder_->add(slot);
    return tell(now);
  }
  Result<void> finish() {
    builder_->finish();
    return tell(last_);
  }

 private:
  Result<void> tell(HostTime now) {
    last_ = now;
    FrameSet set;
    while (builder_->next(now, set)) {
      if (file_ == nullptr) continue;
      simulation_.truth_at(set.instant, *truth_);
      line_.clear();
      append_people_line(*truth_, false, line_);
      line_ += '\n';
      if (auto done = file_->write(std::string_view(line_)); !done) return done;
    }
    return {};
  }

  Simulation& simulation_;
  OutputFile* file_;
  std::unique_ptr<FrameSetBuilder> builder_;
  std::unique_ptr<PeopleFrame> truth_ = std::make_unique<PeopleFrame>();
  std::string line_;
  HostTime last_{};
};

// One folder an imager, one 16-bit PNG a frame, numbered from zero.
class ImageFolders {
 public:
  static Result<ImageFolders> create(const std::string& folder, const Rig& rig) {
    ImageFolders folders;
    for (const RigSensor& sensor : rig.sensors) {
      auto& paths = folders.paths_.emplace_back();
      const std::string path = fmt::format("{}/{}", folder, sensor.name.view());
      if (sensor.kind == SensorKind::kStereo) {
        paths = {path + ".left", path + ".right"};
      } else {
        paths = {path};
      }
      for (const std::string& made_path : paths)
        if (auto made = make_folder(made_path); !made) return tl::unexpected(made.error());
    }
    folders.counts_.resize(folders.paths_.size());
    return folders;
  }
  Result<void> write(const FrameSlot& slot) {
    const std::uint32_t count = counts_[slot.sensor_index]++;
    const auto* pixels = reinterpret_cast<const std::uint16_t*>(slot.bytes.data());
    const std::size_t pixel_count = slot.image_bytes() / sizeof(std::uint16_t);
    for (const std::string& path : paths_[slot.sensor_index]) {
      if (auto done = write_png16(fmt::format("{}/{:06}.png", path, count), {pixels, pixel_count},
                                  slot.width, slot.height);
          !done)
        return done;
      pixels += pixel_count;
    }
    return {};
  }

 private:
  std::vector<std::vector<std::string>> paths_;  // by sensor: one, or left and right
  std::vector<std::uint32_t> counts_;
};

// Everything a simulation is written to.
struct Outputs {
  std::unique_ptr<OutputFile> recording_file, truth_file;
  std::unique_ptr<RecordingWriter> recording;
  std::optional<ImageFolders> images;
};

Result<Outputs> open_outputs(const SimulateOptions& options, const Rig& rig,
                             std::string_view scene_text) {
  Outputs outputs;
  if (!options.truth.empty()) {
    auto file = OutputFile::create(options.truth);
    if (!file) return tl::unexpected(file.error());
    outputs.truth_file = std::move(*file);
  }
  if (!options.images.empty()) {
    auto folders = ImageFolders::create(options.images, rig);
    if (!folders) return tl::unexpected(folders.error());
    outputs.images = std::move(*folders);
  }
  auto file = OutputFile::create(options.out);
  if (!file) return tl::unexpected(file.error());
  outputs.recording_file = std::move(*file);
  RecordingOptions recording;
  recording.mcap.library = kProgramText;
  recording.provenance = {
      {"made_by", kProgramText}, {"source", "simulate"}, {"seed", std::to_string(options.seed)}};
  recording.attachments = {
      {.name = std::string(kSceneAttachment),
       .media_type = "application/toml",
       .data = std::as_bytes(std::span(scene_text.data(), scene_text.size()))}};
  auto writer = RecordingWriter::create(*outputs.recording_file, rig, recording);
  if (!writer) return tl::unexpected(writer.error());
  outputs.recording = std::move(*writer);
  return outputs;
}

// What a driver does with a camera's image: the next one is taken as this one asks for.
void expose(const FrameSlot& slot, SimulatedDevice& device) {
  const GrayImage left{slot.bytes.data(), slot.format, slot.width, slot.height};
  const ExposureStatistics seen = measure_exposure(left, {}, StereoModel::kFullScale);
  const ExposureSettings next = next_exposure(seen, {static_cast<double>(slot.exposure.shutter_us),
                                                     static_cast<double>(slot.exposure.gain_db)})
                                    .next;
  device.set_exposure({static_cast<float>(next.shutter_us), static_cast<float>(next.gain_db)});
}

Result<void> run(const SimulateOptions& options, Simulation& simulation, const Rig& rig,
                 Outputs& outputs) {
  constexpr std::size_t kSlotsPerSensor = 10;  // what the truth's grouping holds back, and one more
  std::size_t slot_bytes = 0;
  for (std::size_t i = 0; i < rig.sensors.size(); ++i)
    slot_bytes = std::max(slot_bytes, simulation.device(i).slot_bytes());
  FramePool pool(kSlotsPerSensor * rig.sensors.size() + 1, slot_bytes);
  TruthWriter truth(simulation, rig, pool, outputs.truth_file.get());
  const HostTime end{from_seconds(options.seconds)};
  double frames_expected = 0;
  for (const RigSensor& sensor : rig.sensors) frames_expected += sensor.rate_hz * options.seconds;
  Progress progress("frames", static_cast<std::uint64_t>(frames_expected));
  while (true) {
    std::size_t sensor = 0;
    if (simulation.upcoming(sensor).arrival >= end) break;
    FrameSlot* slot = pool.acquire();
    if (slot == nullptr) return fail("the simulation holds every slot; this is a defect");
    simulation.next(*slot);
    if (auto done = outputs.recording->write(*slot); !done) return done;
    if (slot->format == PixelFormat::kGray16) expose(*slot, simulation.device(sensor));
    if (outputs.images)
      if (auto done = outputs.images->write(*slot); !done) return done;
    if (auto done = truth.add(slot); !done) return done;
    progress.update(outputs.recording->frame_count());
  }
  if (auto done = truth.finish(); !done) return done;
  if (auto done = outputs.recording->finish(); !done) return done;
  if (outputs.truth_file)
    if (auto done = outputs.truth_file->close(); !done) return done;
  return outputs.recording_file->close();
}

Result<void> simulate(const SimulateOptions& options) {
  const auto file = open_input(options.scene);
  if (!file) return tl::unexpected(file.error());
  const auto scene = parse_scene(file->text(), options.scene);
  if (!scene) return tl::unexpected(scene.error());
  if (scene->sensors.empty())
    return fail(fmt::format("{} has no [[sensor]], so nothing sees its passengers; add one",
                            options.scene));
  const Rig rig = rig_of(*scene);
  if (auto good = check_rig(rig); !good)
    return fail(fmt::format("{}: {}", options.scene, good.error().message));
  auto outputs = open_outputs(options, rig, file->text());
  if (!outputs) return tl::unexpected(outputs.error());
  if (!options.rig_out.empty())
    if (auto done = write_file(options.rig_out, pack_blob(rig)); !done) return done;
  Simulation simulation(*scene, options.seed);
  if (auto done = run(options, simulation, rig, *outputs); !done) return done;
  fmt::print("{}: {} frames of {} sensors in {:.1f} s, {:.1f} MB\n", options.out,
             outputs->recording->frame_count(), rig.sensors.size(), options.seconds,
             static_cast<double>(outputs->recording->mcap().bytes_written()) * 1e-6);
  return {};
}

}  // namespace

void add_simulate(CommandLine& line) {
  auto options = std::make_shared<SimulateOptions>();
  CLI::App* command = line.app.add_subcommand(
      "simulate", "Record a simulated wagon with passengers, and their exact truth");
  command->add_option("--scene", options->scene, "The scene (TOML), as in config/scenes")
      ->required();
  command->add_option("--seconds", options->seconds, "How long")
      ->required()
      ->check(CLI::PositiveNumber);
  command
      ->add_option("--seed", options->seed, "Of everything random; the same seed, the same bytes")
      ->capture_default_str();
  command->add_option("--out", options->out, "The recording (MCAP)")->required();
  command->add_option("--truth", options->truth, "Who was where, one JSON object a line");
  command->add_option("--rig-out", options->rig_out, "The true calibration as a blob");
  command->add_option("--images", options->images,
                      "Folder for 16-bit PNG images, one folder for each sensor "
                      "and two, NAME.left and NAME.right, for a stereo camera");
  command->callback([&line, options] { line.run = [options] { return simulate(*options); }; });
}

}  // namespace wagonsight
