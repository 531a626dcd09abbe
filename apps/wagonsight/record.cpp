#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <optional>

#include "commands.h"
#include "files.h"
#include "progress.h"
#include "recording/recording_writer.h"
#include "recording_file.h"
#include "rig/blob.h"
#include "settings/settings.h"
#include "simulate/room.h"
#include "simulate/scene.h"
#include "simulate/simulation.h"
#include "simulated_recording.h"
#include "version.h"

namespace wagonsight {
namespace {

struct RecordOptions {
  std::string config, out;
  double seconds = 0;
};

// Frames of one or several sensors in the order of their arrival, dated from zero. Neither source
// of today waits for a clock, so a recording takes as long as the computer needs.
class FrameStream {
 public:
  virtual ~FrameStream() = default;
  virtual const Rig& rig() const = 0;
  // The frame that comes next, nullptr at the end. Its sensor_index is of rig().
  virtual Result<FrameSlot*> peek() = 0;
  virtual void take() = 0;
};

class SimulatedStream final : public FrameStream {
 public:
  SimulatedStream(const Scene& scene, std::uint64_t seed)
      : rig_(rig_of(scene)), simulation_(scene, seed), memory_(640 * 480 * sizeof(std::uint16_t)) {
    for (RigSensor& sensor : rig_.sensors) sensor.kind = SensorKind::kKinect;  // all is depth here
    slot_.bytes = memory_;
  }
  const Rig& rig() const override { return rig_; }
  Result<FrameSlot*> peek() override {
    if (!is_full_) simulation_.next(slot_);
    is_full_ = true;
    return &slot_;
  }
  void take() override { is_full_ = false; }

 private:
  Rig rig_;
  Simulation simulation_;
  std::vector<std::byte> memory_;
  FrameSlot slot_;
  bool is_full_ = false;
};

class RecordedStream final : public FrameStream {
 public:
  explicit RecordedStream(RecordingFile recording)
      : recording_(std::move(recording)), memory_(recording_.reader->slot_bytes()) {
    slot_.bytes = memory_;
  }
  const Rig& rig() const override { return recording_.reader->rig(); }
  Result<FrameSlot*> peek() override {
    if (!is_full_) {
      const auto more = recording_.reader->next(slot_);
      if (!more) return fail(fmt::format("{} {}", recording_.path, more.error().message));
      if (!*more) return nullptr;
      const Duration start = recording_.reader->start().time_since_epoch();
      slot_.instant -= start;
      slot_.arrival -= start;
    }
    is_full_ = true;
    return &slot_;
  }
  void take() override { is_full_ = false; }

 private:
  RecordingFile recording_;
  std::vector<std::byte> memory_;
  FrameSlot slot_;
  bool is_full_ = false;
};

// A stream and which sensors of the recording its own are; nothing: not wanted.
struct Source {
  std::string file;  // empty: the simulation
  std::unique_ptr<FrameStream> stream;
  std::array<std::optional<std::uint8_t>, kSensorsMax> rig_index{};
};

Result<std::unique_ptr<FrameStream>> open_stream(const SensorSettings& sensor,
                                                 const Settings& settings) {
  if (sensor.source == SensorSource::kRecording) {
    auto recording = open_recording(sensor.file, DamagePolicy::kSkip);
    if (!recording) return tl::unexpected(recording.error());
    return std::make_unique<RecordedStream>(std::move(*recording));
  }
  if (sensor.source == SensorSource::kDevice)
    return fail(
        fmt::format("settings: sensor {}: is a device, which only the daemon opens; record "
                    "simulated sensors and recordings with this command",
                    sensor.name.view()));
  const auto text = open_input(settings.demo.scene);
  if (!text) return tl::unexpected(text.error());
  const auto scene = parse_scene(text->text(), settings.demo.scene);
  if (!scene) return tl::unexpected(scene.error());
  if (scene->sensors.empty())
    return fail(fmt::format("{} has no [[sensor]]; add one", settings.demo.scene));
  return std::make_unique<SimulatedStream>(*scene, settings.demo.seed);
}

// The settings' sensors; without any, all of the simulated scene.
Result<std::vector<SensorSettings>> wanted_sensors(const Settings& settings,
                                                   const std::string& path) {
  if (!settings.sensors.empty()) return settings.sensors;
  if (settings.demo.scene.empty())
    return fail(fmt::format("{} names no sensor and no scene; add [[sensor]] sections", path));
  const auto text = open_input(settings.demo.scene);
  if (!text) return tl::unexpected(text.error());
  const auto scene = parse_scene(text->text(), settings.demo.scene);
  if (!scene) return tl::unexpected(scene.error());
  std::vector<SensorSettings> sensors;
  for (const SceneSensor& sensor : scene->sensors) {
    sensors.emplace_back().name = Name(sensor.name);
    sensors.back().source = SensorSource::kSimulated;
  }
  return sensors;
}

class Recorder {
 public:
  static Result<Recorder> create(const Settings& settings, const std::string& config);
  Result<void> run(const RecordOptions& options);

 private:
  Result<void> add(const SensorSettings& wanted, const Settings& settings);
  Result<void> take_calibration(const std::string& path);
  Result<Source*> next_source();

  Rig rig_;
  std::vector<Source> sources_;
  std::string scene_text_;  // of the simulation, kept beside its frames; empty: none
};

Result<void> Recorder::add(const SensorSettings& wanted, const Settings& settings) {
  const std::string file = wanted.source == SensorSource::kRecording ? wanted.file : std::string();
  auto source = std::find_if(sources_.begin(), sources_.end(),
                             [&](const Source& known) { return known.file == file; });
  if (source == sources_.end()) {
    auto stream = open_stream(wanted, settings);
    if (!stream) return tl::unexpected(stream.error());
    sources_.push_back({file, std::move(*stream), {}});
    source = sources_.end() - 1;
  }
  if (file.empty() && scene_text_.empty()) {
    const auto scene = open_input(settings.demo.scene);
    if (!scene) return tl::unexpected(scene.error());
    scene_text_ = scene->text();
  }
  const Rig& known = source->stream->rig();
  const int index = find_sensor(known, wanted.name.view());
  if (index < 0)
    return fail(fmt::format("{} has no sensor {}; `wagonsight inspect` tells which it has",
                            file.empty() ? settings.demo.scene : file, wanted.name.view()));
  source->rig_index[static_cast<std::size_t>(index)] =
      static_cast<std::uint8_t>(rig_.sensors.size());
  rig_.sensors.push_back(known.sensors[static_cast<std::size_t>(index)]);
  if (known.georeference.present) rig_.georeference = known.georeference;
  return {};
}

// The settings' blob replaces what the sources know of their sensors.
Result<void> Recorder::take_calibration(const std::string& path) {
  const auto file = open_input(path);
  if (!file) return tl::unexpected(file.error());
  const auto blob = open_blob(file->bytes());
  if (!blob) return fail(fmt::format("{}: {}", path, blob.error().message));
  for (RigSensor& sensor : rig_.sensors) {
    const int index = find_sensor(blob->rig, sensor.name.view());
    if (index < 0)
      return fail(
          fmt::format("{} has no sensor {}, which the settings name", path, sensor.name.view()));
    const RigSensor& calibrated = blob->rig.sensors[static_cast<std::size_t>(index)];
    if (calibrated.camera.width != sensor.camera.width ||
        calibrated.camera.height != sensor.camera.height)
      return fail(fmt::format("{}: sensor {} has {} x {} pixels and its frames {} x {}", path,
                              sensor.name.view(), calibrated.camera.width, calibrated.camera.height,
                              sensor.camera.width, sensor.camera.height));
    sensor = calibrated;
  }
  rig_.georeference = blob->rig.georeference;
  return {};
}

Result<Recorder> Recorder::create(const Settings& settings, const std::string& config) {
  const auto wanted = wanted_sensors(settings, config);
  if (!wanted) return tl::unexpected(wanted.error());
  Recorder recorder;
  for (const SensorSettings& sensor : *wanted)
    if (auto done = recorder.add(sensor, settings); !done) return tl::unexpected(done.error());
  if (!settings.rig.blob.empty())
    if (auto done = recorder.take_calibration(settings.rig.blob); !done)
      return tl::unexpected(done.error());
  recorder.rig_.provenance.made_by = FixedString<80>(kProgramText);
  recorder.rig_.provenance.note = "record";
  if (auto good = check_rig(recorder.rig_); !good)
    return fail(fmt::format("{}: {}", config, good.error().message));
  return recorder;
}

// The source whose next frame arrives first; nullptr when all have ended.
Result<Source*> Recorder::next_source() {
  Source* first = nullptr;
  HostTime earliest{};
  for (Source& source : sources_) {
    const auto slot = source.stream->peek();
    if (!slot) return tl::unexpected(slot.error());
    if (*slot == nullptr || (first != nullptr && (*slot)->arrival >= earliest)) continue;
    first = &source;
    earliest = (*slot)->arrival;
  }
  return first;
}

Result<void> Recorder::run(const RecordOptions& options) {
  auto file = OutputFile::create(options.out);
  if (!file) return tl::unexpected(file.error());
  (*file)->keep_when_unfinished();  // every whole chunk of it can be read
  RecordingOptions recording;
  recording.mcap.library = kProgramText;
  recording.provenance = {{"made_by", kProgramText}, {"source", "record"}};
  if (!scene_text_.empty())
    recording.attachments = {
        {.name = std::string(kSceneAttachment),
         .media_type = "application/toml",
         .data = std::as_bytes(std::span(scene_text_.data(), scene_text_.size()))}};
  auto writer = RecordingWriter::create(**file, rig_, recording);
  if (!writer) return tl::unexpected(writer.error());
  const HostTime end{from_seconds(options.seconds)};
  double expected = 0;
  for (const RigSensor& sensor : rig_.sensors) expected += sensor.rate_hz * options.seconds;
  Progress progress("frames", static_cast<std::uint64_t>(expected));
  HostTime last{};
  while (true) {
    const auto source = next_source();
    if (!source) return tl::unexpected(source.error());
    if (*source == nullptr) break;
    FrameSlot* slot = *(*source)->stream->peek();
    if (slot->arrival >= end) break;
    last = slot->arrival;
    const std::uint8_t own_index = slot->sensor_index;
    if (const auto index = (*source)->rig_index[own_index]) {
      slot->sensor_index = *index;
      if (auto done = (*writer)->write(*slot); !done) return done;
      slot->sensor_index = own_index;
      progress.update((*writer)->frame_count());
    }
    (*source)->stream->take();
  }
  if (auto done = (*writer)->finish(); !done) return done;
  if (auto done = (*file)->close(); !done) return done;
  fmt::print("{}: {} frames of {} sensors in {:.1f} s, {:.1f} MB\n", options.out,
             (*writer)->frame_count(), rig_.sensors.size(), to_seconds(last.time_since_epoch()),
             static_cast<double>((*writer)->mcap().bytes_written()) * 1e-6);
  return {};
}

Result<void> record(const RecordOptions& options) {
  const auto text = open_input(options.config);
  if (!text) return tl::unexpected(text.error());
  const auto settings = parse_settings(text->text(), options.config);
  if (!settings) return tl::unexpected(settings.error());
  auto recorder = Recorder::create(*settings, options.config);
  if (!recorder) return tl::unexpected(recorder.error());
  return recorder->run(options);
}

}  // namespace

void add_record(CommandLine& line) {
  auto options = std::make_shared<RecordOptions>();
  CLI::App* command = line.app.add_subcommand(
      "record", "Record the sensors of the settings (today: simulated ones and recordings)");
  command->add_option("--config", options->config, "Settings (TOML)")->required();
  command->add_option("--seconds", options->seconds, "How long")
      ->required()
      ->check(CLI::PositiveNumber);
  command->add_option("--out", options->out, "The recording (MCAP)")->required();
  command->callback([&line, options] { line.run = [options] { return record(*options); }; });
}

}  // namespace wagonsight
