#include "daemon.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <vector>

#include "depot_recorder.h"
#include "devices.h"
#include "drift_watch.h"
#include "frame_source.h"
#include "http/server.h"
#include "linux/clocks.h"
#include "linux/held_memory.h"
#include "linux/stop_signals.h"
#include "linux/threads.h"
#include "publisher.h"
#include "pulse_thread.h"
#include "safe_mode.h"
#include "shared_block.h"
#include "thermal_watch.h"
#include "tracking.h"
#include "unit.h"
#include "vehicle/vehicle_input.h"
#include "version.h"
#include "vigil.h"
#include "web_supervisor.h"

namespace wagonsight {
namespace {

constexpr Duration kPublishPeriod = std::chrono::milliseconds(33);
// Time to build worlds and pipelines before the first simulated or recorded frame is due.
constexpr Duration kSourceDelay = std::chrono::milliseconds(1500);
// While all sensors give frames a set waits for the last of them, one set is worked on and one
// frame arrives: three of each. One sensor that is late lets the others' frames wait for a period
// and a half and 60 ms: four of each, and those two, but none of its own.
constexpr std::size_t kSlotsPerSensor = 4, kSlotsMore = 2;

// The tracking turns every few milliseconds, on a slow computer several times a second. A driver
// may wait long for a device that is being plugged in.
constexpr double kTrackingSilenceMaxS = 8.0;
constexpr double kDriverSilenceMaxS = 30.0;

DepotOptions depot_options(const Settings& unit) {
  const RecordingSettings& settings = unit.recording;
  const auto bytes = [](double mb) { return static_cast<std::uint64_t>(mb * (1U << 20U)); };
  DepotOptions options;
  options.folder = settings.folder;
  options.has_vehicle = !unit.vehicle.socket.empty();
  options.made_by = fmt::format("wagonsight {}", kVersionText);
  options.file_length = from_seconds(60 * settings.file_minutes);
  options.memory_bytes = bytes(settings.memory_mb);
  options.free_bytes_min = bytes(settings.free_mb_min);
  return options;
}

std::array<RayTable, kSensorsMax> rays_of(const Pipeline& pipeline) {
  std::array<RayTable, kSensorsMax> rays;
  for (std::size_t i = 0; i < kSensorsMax; ++i) rays[i] = pipeline.rays(i);
  return rays;
}

// What the daemon consists of once it runs; made in this order, taken down in the reverse one.
class Daemon {
 public:
  Daemon(std::unique_ptr<Unit> unit, HostTime start, SharedBlockWriter shared,
         ListeningSocket listening, const AccessRules& access, const std::string& updater)
      : unit_(std::move(unit)),
        start_(start),
        shared_(std::move(shared)),
        log_(shared_.block(), start),
        pool_(kSlotsPerSensor * unit_->rig.sensors.size() + kSlotsMore, unit_->slot_bytes),
        recorder_(unit_->rig, unit_->slot_bytes, depot_options(unit_->settings)),
        drift_(unit_->rig, rays_of(*unit_->pipeline),
               unit_->blob_file.path.empty() ? std::string() : unit_->blob_file.path + ".static",
               unit_->blob_sha256),
        tracking_(std::move(unit_->pipeline), std::move(unit_->workers), unit_->rig,
                  unit_->settings.capture, pool_, bell_, start),
        pulses_(open_trigger(unit_->settings.sensors), [this] { return tracking_.last_tick(); }),
        thermal_(unit_->settings.thermal,
                 [this](Severity severity, std::string_view text) { log_.say(severity, text); }),
        publisher_(*unit_, shared_.block(), log_, start),
        listening_(listening),
        web_(
            shared_.fd(), listening.fd, access,
            [this](std::string_view text) { log_.say(Severity::kWarning, text); },
            [this](const UnitCommand& command) { obey(command); }, updater) {
    for (FrameSource& source : unit_->sources)
      sources_.push_back(
          std::make_unique<SourceThread>(std::move(source), pool_, bell_, &recorder_));
  }
  ~Daemon() {
    pulses_.stop();
    tracking_.stop();
    drift_.stop();
    for (auto& source : sources_) source->stop();
    close(listening_.fd);
  }
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  void start() {
    hold_all_memory();
    for (const std::string& remark : unit_->remarks) log_.say(Severity::kWarning, remark);
    log_.say(Severity::kNote, fmt::format("wagonsight {} watches with {} sensors.", kVersionText,
                                          unit_->rig.sensors.size()));
    std::vector<SourceThread*> sources;
    for (auto& source : sources_) {
      source->start();
      sources.push_back(source.get());
    }
    drift_.start();
    tracking_.start(std::move(sources), &drift_);
    pulses_.start();
    open_vehicle();
    if (unit_->settings.recording.at_start) record(unit_->settings.recording.minutes);
    publish();
    // Without a page the wagon is still watched, and the supervisor keeps trying.
    if (const auto started = web_.start(seconds()); !started)
      log_.say(Severity::kError, started.error().message);
  }

  void run_until(const StopSignals& signals, Vigil& vigil) {
    watch_stages(vigil);
    vigil.ready("watching the wagon");
    while (!signals.wait(kPublishPeriod)) {
      publish();
      web_.tick(seconds());
      const WallTime wall = wall_now();
      vigil.tick(seconds(), wall.synchronised ? wall.unix_s : 0,
                 [this](std::string_view text) { log_.say(Severity::kError, text); });
    }
    log_.say(Severity::kNote, "Told to stop.");
  }

 private:
  void publish() {
    hear_vehicle();
    if (thermal_.tick(seconds())) tracking_.set_rate_limit(thermal_.status().rate_limit_hz);
    publisher_.publish(tracking_, drift_, sources_, pool_, web_.restarts(), recorder_.status(),
                       vehicle_ == nullptr ? VehicleState{} : vehicle_->state(), thermal_.status());
  }

  void hear_vehicle() {
    if (vehicle_ == nullptr || !vehicle_->tick(seconds())) return;
    const VehicleState& state = vehicle_->state();
    VehicleStateMessage message{
        host_now(), state.has_speed, state.speed, state.has_stop, std::string(state.stop.view()),
        {}};
    for (std::size_t i = 0; i < state.doors.size(); ++i)
      message.doors.push_back({std::string(unit_->wagon.doors[i].name.view()),
                               static_cast<std::uint8_t>(state.doors[i])});
    recorder_.tell_vehicle(message);
    tracking_.hear_doors(state.doors);
  }

  // Without its signals the wagon is watched as before.
  void open_vehicle() {
    const VehicleSettings& settings = unit_->settings.vehicle;
    if (settings.socket.empty()) return;
    VehicleOptions options;
    options.socket = settings.socket;
    options.silence_s = settings.silence_s;
    for (const Door& door : unit_->wagon.doors) options.doors.push_back(door.name);
    auto opened = VehicleInput::open(std::move(options));
    if (opened)
      vehicle_ = std::move(*opened);
    else
      log_.say(Severity::kError, opened.error().message);
  }

  void record(double minutes) {
    if (const auto started = recorder_.start(from_seconds(60 * minutes)); !started)
      log_.say(Severity::kError, started.error().message);
  }

  // The web side has asked who may; here it is bounded what may be asked.
  void obey(const UnitCommand& command) {
    const RecordingSettings& settings = unit_->settings.recording;
    if (command.kind == UnitCommand::Kind::kStopRecording) {
      recorder_.stop();
    } else if (!settings.folder.empty()) {
      record(std::clamp(static_cast<double>(command.minutes), 1.0, settings.minutes));
    }
  }

  // Everything is allocated and there is no other thread yet.
  void hold_all_memory() {
    const auto held = hold_memory();
    if (!held) {
      log_.say(Severity::kWarning, held.error().message);
      return;
    }
    log_.say(Severity::kNote, fmt::format("{:.1f} MB of memory are held, {:.1f} MB of them locked.",
                                          static_cast<double>(held->held_bytes) / (1U << 20U),
                                          static_cast<double>(held->locked_bytes) / (1U << 20U)));
  }

  void watch_stages(Vigil& vigil) {
    vigil.watch(
        "The tracking", kTrackingSilenceMaxS, [this] { return tracking_.turns(); }, seconds());
    const Workers& workers = tracking_.workers();
    for (std::size_t i = 0; i < workers.helper_count(); ++i)
      vigil.watch(
          fmt::format("Worker {}", i + 1), kTrackingSilenceMaxS,
          [&workers, i] { return workers.turns(i); }, seconds());
    for (const auto& source : sources_)
      vigil.watch(
          fmt::format("The driver of {}", source->name()), kDriverSilenceMaxS,
          [&thread = *source]() -> std::optional<std::uint64_t> {
            if (thread.ended()) return std::nullopt;
            return thread.turns();
          },
          seconds());
  }

  static double seconds() { return to_seconds(host_now().time_since_epoch()); }

  std::unique_ptr<Unit> unit_;
  HostTime start_;
  SharedBlockWriter shared_;
  UnitLog log_;
  FramePool pool_;
  FrameBell bell_;
  DepotRecorder recorder_;
  std::unique_ptr<VehicleInput> vehicle_;  // nullptr: none
  std::vector<std::unique_ptr<SourceThread>> sources_;
  DriftWatch drift_;
  Tracking tracking_;
  PulseThread pulses_;
  ThermalWatch thermal_;
  Publisher publisher_;
  ListeningSocket listening_;
  WebSupervisor web_;
};

std::string address_text(const std::string& host, std::uint16_t port) {
  const bool v6 = host.find(':') != std::string::npos && host.front() != '[';
  return fmt::format("http://{}{}{}:{}/", v6 ? "[" : "", host, v6 ? "]" : "", port);
}

}  // namespace

namespace {

Result<void> run_unit(const DaemonOptions& options, const StopSignals& signals, Vigil& vigil) {
  const HostTime start = host_now();
  auto unit = assemble_unit(options.config, options.rig, start + kSourceDelay);
  if (!unit) return tl::unexpected(unit.error());
  const WebSettings& web = (*unit)->settings.web;
  const std::string host = web.host;
  const auto access = access_rules(web);
  if (!access) return tl::unexpected(access.error());
  const auto listening = listen_on(host, options.port.value_or(web.port));
  if (!listening) return tl::unexpected(listening.error());
  const auto info = std::make_unique<UnitInfo>(unit_info(**unit, kVersionText));
  info->last_crash = last_crash(vigil.previous());
  auto shared = SharedBlockWriter::create(*info);
  if (!shared) return tl::unexpected(shared.error());

  Daemon daemon(std::move(*unit), start, std::move(*shared), *listening, *access, options.updater);
  daemon.start();
  fmt::print("{}\n", address_text(host, listening->port));
  std::fflush(stdout);
  daemon.run_until(signals, vigil);
  return {};
}

}  // namespace

Result<void> run_daemon(const DaemonOptions& options) {
  const StopSignals signals;  // before any thread
  Vigil vigil(options.state_folder);
  if (!vigil.remark().empty()) fmt::print(stderr, "wagonsightd: {}\n", vigil.remark());
  auto done = vigil.is_crash_loop() ? run_safe_mode(options, signals, vigil)
                                    : run_unit(options, signals, vigil);
  if (done)
    vigil.ended();
  else
    vigil.failed(done.error().message);
  return done;
}

}  // namespace wagonsight
