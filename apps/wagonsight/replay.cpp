#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <optional>
#include <thread>

#include "cloud_files.h"
#include "commands.h"
#include "common/grouping_options.h"
#include "frame_sets.h"
#include "fusion/fused_cloud.h"
#include "linux/workers.h"
#include "pipeline/stereo_lane.h"
#include "progress.h"
#include "recording_file.h"
#include "replay_setup.h"
#include "snapshot/json_lines.h"
#include "stage_timing.h"

namespace wagonsight {
namespace {

constexpr std::string_view kCausal = "causal";
constexpr std::string_view kWhole = "whole";
constexpr std::string_view kNone = "none";

struct ReplayOptions {
  std::string recording, config, rig, sensor, out;
  std::string background;  // causal, whole, none or a file
  std::string save_background, clouds, timing;
  int workers = 0;  // 0: as the settings say
  bool realtime = false;
  bool skip_damaged = false;
};

// One replay: the recording, what it is replayed with, and where the answers go.
class Replay {
 public:
  Replay(ReplayOptions options, RecordingFile recording, ReplaySetup setup,
         std::unique_ptr<Workers> workers, std::unique_ptr<Pipeline> pipeline)
      : options_(std::move(options)),
        recording_(std::move(recording)),
        setup_(std::move(setup)),
        workers_(std::move(workers)),
        pipeline_(std::move(pipeline)),
        sets_(*recording_.reader, setup_.rig, grouping_options(setup_.capture, setup_.rig)) {}

  Result<void> run();

 private:
  Result<void> prepare_background();
  Result<void> process_all(OutputFile& out);
  Result<void> write_cloud(std::uint64_t index);
  void wait_for(HostTime instant);
  Duration processor_time() const {
    return StageTimings::thread_time() + workers_->helpers_cpu_time();
  }
  static HostTime newest_instant(const FrameSet& set);
  void note_latency(const FrameSet& set, Duration took);
  void note_stereo(const FrameSet& set);
  void hear_doors();
  tl::unexpected<Error> in_recording(const Error& error) const {
    const bool is_damage = recording_.reader->cursor().damaged_chunks() > 0;
    return fail(fmt::format("{} {}{}", recording_.path, error.message,
                            is_damage ? "; --skip-damaged goes on without it" : ""));
  }

  ReplayOptions options_;
  RecordingFile recording_;
  ReplaySetup setup_;
  std::unique_ptr<Workers> workers_;
  std::unique_ptr<Pipeline> pipeline_;
  FrameSetSource sets_;
  StageTimings timings_;
  std::vector<CloudPoint> cloud_;
  std::optional<std::chrono::steady_clock::time_point> real_start_;
  HostTime first_instant_{}, last_instant_{};
  HostTime free_at_{};  // when the pipeline has answered all instants so far, as the daemon's would
  std::uint64_t set_count_ = 0;
};

Result<void> Replay::prepare_background() {
  const std::string& choice = options_.background;
  if (choice == kCausal || choice == kNone) return {};
  if (choice != kWhole) {
    const auto file = open_input(choice);
    if (!file) return tl::unexpected(file.error());
    if (auto loaded = pipeline_->load_background(file->bytes()); !loaded)
      return fail(fmt::format("{}: {}", choice, loaded.error().message));
    return {};
  }
  Progress progress("frames learned", frame_count_hint(*recording_.reader));
  FrameSet set;
  for (std::uint64_t count = 1;; ++count) {
    const auto more = sets_.next(set);
    if (!more) return in_recording(more.error());
    if (!*more) break;
    pipeline_->learn(set);
    progress.update(count);
  }
  pipeline_->finish_learning();
  sets_.rewind();
  return {};
}

void Replay::wait_for(HostTime instant) {
  if (!real_start_) real_start_ = std::chrono::steady_clock::now();
  std::this_thread::sleep_until(*real_start_ + (instant - first_instant_));
}

// When the last of its frames was taken: nothing can be told before.
HostTime Replay::newest_instant(const FrameSet& set) {
  HostTime newest = set.instant;
  for (const SensorFrame& frame : set.sensors)
    if (frame.state == FrameState::kPresent) newest = std::max(newest, frame.slot->instant);
  return newest;
}

// The daemon's frames are there when they were taken; here they are read from a file by the same
// thread, which is not counted. An instant waits for the ones before it.
void Replay::note_latency(const FrameSet& set, Duration took) {
  const HostTime there = newest_instant(set);
  free_at_ = std::max(free_at_, there) + took;
  timings_.add_latency(free_at_ - there, pipeline_->learning());
}

void Replay::note_stereo(const FrameSet& set) {
  for (std::size_t i = 0; i < setup_.rig.sensors.size(); ++i)
    if (const StereoReport* report = pipeline_->stereo_report(i);
        report != nullptr && set.sensors[i].state == FrameState::kPresent)
      timings_.add_matched_share(report->matched_share);
}

Result<void> Replay::write_cloud(std::uint64_t index) {
  cloud_.clear();
  for (const FusedPoint& point : pipeline_->fused_points())
    cloud_.push_back({point.x, point.y, point.z});
  return write_ply(fmt::format("{}/{:06}.ply", options_.clouds, index), cloud_);
}

// The train's doors are known by their names; the wagon's may be another description's.
void Replay::hear_doors() {
  const VehicleStateMessage* said = recording_.reader->vehicle();
  if (said == nullptr) return;
  DoorStates doors;
  for (const Door& door : setup_.wagon.doors) {
    const auto named = std::find_if(said->doors.begin(), said->doors.end(),
                                    [&](const auto& one) { return one.name == door.name.view(); });
    const bool is_closed =
        named != said->doors.end() && named->state == VehicleStateMessage::kClosed;
    doors.push_back(is_closed ? DoorState::kClosed : DoorState::kUnknown);
  }
  pipeline_->hear_doors({doors.data(), doors.size()});
}

Result<void> Replay::process_all(OutputFile& out) {
  Progress progress("frames", frame_count_hint(*recording_.reader) / setup_.rig.sensors.size());
  if (!options_.timing.empty()) pipeline_->set_ticker(StageTimings::now);
  pipeline_->set_start(recording_.reader->start());
  recording_.reader->listen_to_vehicle();
  FrameSet set;
  std::string line;
  while (true) {
    const auto more = sets_.next(set);
    if (!more) return in_recording(more.error());
    if (!*more) return {};
    if (set_count_ == 0) first_instant_ = set.instant;
    last_instant_ = set.instant;
    if (options_.realtime) wait_for(newest_instant(set));
    const Duration before = processor_time();
    const auto began = std::chrono::steady_clock::now();
    hear_doors();
    const PeopleFrame& frame = pipeline_->process(set);
    if (options_.realtime) note_latency(set, std::chrono::steady_clock::now() - began);
    timings_.add(pipeline_->last_stage_times(), processor_time() - before);
    note_stereo(set);
    line.clear();
    append_people_line(frame, true, line);
    line += '\n';
    if (auto done = out.write(std::string_view(line)); !done) return done;
    if (!options_.clouds.empty())
      if (auto done = write_cloud(set_count_); !done) return done;
    progress.update(++set_count_);
  }
}

Result<void> Replay::run() {
  if (!options_.clouds.empty())
    if (auto made = make_folder(options_.clouds); !made) return made;
  workers_->start();
  auto out = OutputFile::create(options_.out);
  if (!out) return tl::unexpected(out.error());
  if (auto done = prepare_background(); !done) return done;
  if (auto done = process_all(**out); !done) return done;
  if (auto done = (*out)->close(); !done) return done;
  if (!options_.save_background.empty())
    if (auto done = write_file(options_.save_background, pipeline_->save_background()); !done)
      return done;
  const Duration recorded = last_instant_ - first_instant_;
  if (!options_.timing.empty())
    if (auto done = write_file(options_.timing, timings_.to_json(recorded)); !done) return done;
  const std::string trouble = recording_trouble(recording_);
  if (!trouble.empty()) fmt::print(stderr, "wagonsight replay: {}\n", trouble);
  if (!setup_.remark.empty())
    fmt::print(stderr, "wagonsight replay: {}: {}\n", recording_.path, setup_.remark);
  fmt::print("{}: {} instants over {:.1f} s, background {}{}{}\n", options_.out, set_count_,
             to_seconds(recorded), options_.background, setup_.background_reason,
             setup_.floor_found);
  return {};
}

// What suits the recording where nothing was asked for.
std::string suitable_background(ReplaySetup& setup) {
  // From here on learning counts better than looking at shapes, on parts of real recordings.
  constexpr std::uint64_t kFramesMin = 8;
  const std::uint64_t frames = setup.frame_count / setup.rig.sensors.size();
  if (frames < kFramesMin) {
    setup.background_reason = fmt::format(
        " ({} frame{} of a sensor are too few to learn one; people are told by their shape)",
        frames, frames == 1 ? "" : "s");
    return std::string(kNone);
  }
  return std::string(setup.had_pose ? kCausal : kWhole);
}

Result<void> replay(ReplayOptions options) {
  const DamagePolicy policy = options.skip_damaged ? DamagePolicy::kSkip : DamagePolicy::kStop;
  auto recording = open_recording(options.recording, policy);
  if (!recording) return tl::unexpected(recording.error());
  if (!options.sensor.empty())
    if (auto taken = recording->reader->take_only(options.sensor); !taken)
      return fail(fmt::format("{} {}", options.recording, taken.error().message));
  auto setup = set_up_replay(*recording, options.config, options.rig);
  if (!setup) return tl::unexpected(setup.error());
  if (options.background.empty()) options.background = suitable_background(*setup);
  setup->options.without_background = options.background == kNone;
  if (setup->options.without_background && !options.save_background.empty())
    return fail(fmt::format(
        "{}: with --background none nothing is learned that --save-background could write",
        options.save_background));
  if (options.workers == 0) options.workers = setup->workers;
  auto workers =
      std::make_unique<Workers>(suitable_workers(options.workers, has_stereo(setup->rig)));
  setup->options.runner = workers.get();
  auto pipeline =
      options.config.empty()
          ? Pipeline::create_fitting(setup->rig, setup->rays, setup->wagon, setup->options)
          : Pipeline::create(setup->rig, setup->rays, setup->wagon, setup->options);
  if (!pipeline) return fail(fmt::format("{}: {}", options.recording, pipeline.error().message));
  Replay run(std::move(options), std::move(*recording), std::move(*setup), std::move(workers),
             std::move(*pipeline));
  return run.run();
}

}  // namespace

void add_replay(CommandLine& line) {
  auto options = std::make_shared<ReplayOptions>();
  CLI::App* command = line.app.add_subcommand(
      "replay", "Find the people in a recording: one JSON line for each instant");
  command->add_option("recording", options->recording, "The recording (MCAP)")->required();
  command->add_option("--out", options->out, "The people, one JSON object a line")->required();
  command->add_option("--config", options->config,
                      "Settings (TOML); without them, defaults that suit one such recording");
  command->add_option("--rig", options->rig,
                      "Calibration blob instead of the recording's own calibration");
  command->add_option("--sensor", options->sensor,
                      "This sensor's frames alone (default: those of all together)");
  command->add_option("--background", options->background,
                      "causal: learn as it goes; whole: learn from the whole recording first; or a "
                      "file that --save-background wrote; none: learn nothing, tell people from "
                      "furniture by their shape. Default: causal; whole where the recording's "
                      "sensor has no pose; none where it has fewer than eight frames");
  command->add_option("--save-background", options->save_background,
                      "Write the background as it is after the replay");
  command->add_option("--clouds", options->clouds,
                      "Folder for the foreground clouds in W, one PLY for each instant");
  command
      ->add_option("--workers", options->workers,
                   "Threads that share the sensors of an instant, 1 to 8; the people are the "
                   "same with any number (default: as the settings say)")
      ->check(CLI::Range(1, 8));
  command->add_option("--timing", options->timing, "What it cost, per stage (JSON)");
  command->add_flag("--realtime", options->realtime, "Take the time the recording took");
  command->add_flag("--skip-damaged", options->skip_damaged,
                    "Leave damaged chunks out instead of stopping at them");
  command->callback([&line, options] { line.run = [options] { return replay(*options); }; });
}

}  // namespace wagonsight
