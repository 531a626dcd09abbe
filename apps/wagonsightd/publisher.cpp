#include "publisher.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>

#include "linux/clocks.h"
#include "linux/resources.h"
#include "linux/sealed_heap.h"
#include "snapshot/json_lines.h"

namespace wagonsight {
namespace {

constexpr double kSilentS = 1.0;       // a sensor without frames for so long is lost
constexpr double kStartS = 5.0;        // so long a sensor may take for its first frame
constexpr double kSettleS = 1.0;       // of frames that are judged before the start is over
constexpr double kLastingS = 1.5;      // a change of state is logged after so long
constexpr double kRateShareMin = 0.8;  // below, a sensor is degraded
constexpr double kDroppedShareMax = 0.01;
constexpr std::array<const char*, kStageCount> kStageNames = {"to depth", "extract", "fuse",
                                                              "people", "situation"};

double share(std::uint64_t part, std::uint64_t rest) {
  return part + rest == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(part + rest);
}

}  // namespace

UnitLog::UnitLog(SharedBlock& block, HostTime daemon_start)
    : block_(block), daemon_start_(daemon_start), tail_(std::make_unique<LogTail>()) {}

void UnitLog::say(Severity severity, std::string_view text) {
  constexpr std::array kWords = {"", "warning: ", "error: "};
  fmt::print(stderr, "wagonsightd: {}{}\n", kWords[static_cast<std::size_t>(severity)], text);
  auto& lines = tail_->lines;
  if (lines.full()) {
    std::copy(lines.begin() + 1, lines.end(), lines.begin());
    lines.pop_back();
  }
  const WallTime wall = wall_now();
  lines.push_back({to_seconds(host_now() - daemon_start_), wall.synchronised ? wall.unix_s : 0,
                   severity, text});
  block_.log.store(*tail_);
}

Publisher::Publisher(const Unit& unit, SharedBlock& block, UnitLog& log, HostTime daemon_start)
    : block_(block),
      log_(log),
      daemon_start_(daemon_start),
      snapshot_(std::make_unique<Snapshot>()),
      report_(std::make_unique<TrackingReport>()) {
  snapshot_->calibration = unit.calibration;
  snapshot_->learning = true;
  for (const RigSensor& sensor : unit.rig.sensors) {
    SensorStatus status;
    status.name = sensor.name;
    status.kind = sensor.kind == SensorKind::kKinect ? "kinect" : "stereo";
    status.expected_fps = sensor.rate_hz;
    status.rms_px = sensor.rms_px;
    snapshot_->sensors.push_back(status);
  }
  for (const char* name : kStageNames) snapshot_->stages.push_back({name, 0, 0, 0});
}

void Publisher::publish(const Tracking& tracking, const DriftWatch& drift,
                        const std::vector<std::unique_ptr<SourceThread>>& sources,
                        const FramePool& pool, std::uint32_t web_restarts,
                        const RecordingStatus& recording, const VehicleState& vehicle,
                        const ThermalStatus& thermal) {
  Snapshot& s = *snapshot_;
  ++s.sequence;
  const HostTime now = host_now();
  s.time = to_seconds(now - daemon_start_);
  s.monotonic_time = to_seconds(now.time_since_epoch());
  const WallTime wall = wall_now();
  s.unix_time = wall.synchronised ? wall.unix_s : 0;
  if (tracking.report(*report_)) {
    s.frame = report_->frame;
    s.occupancy = report_->occupancy;
    s.framesets = report_->framesets;
    s.framesets_dropped = report_->framesets_dropped;
    s.pipeline_latency_ms = report_->latency_ms;
    settle();
  }
  s.web_restarts = web_restarts;
  s.recording = recording;
  s.vehicle = vehicle;
  s.thermal = thermal;
  s.thermal.spared_instants = report_->framesets_spared;
  tell_sensors(sources);
  tell_rates();
  tell_stages();
  tell_unit(pool);
  tell_drift(drift);
  log_changes();
  block_.snapshot.store(s);
}

// The start is learning and a second more. Its first instants are slow and lose frames while the
// first background is drawn up; that is no fault of a sensor and must not look like one for the
// ten seconds of the rates, so they count from the end of learning on.
void Publisher::settle() {
  Snapshot& s = *snapshot_;
  if (report_->learning || settled_) {
    s.learning = report_->learning;
    return;
  }
  if (learned_at_ < 0) {
    learned_at_ = s.time;
    samples_.clear();
  }
  settled_ = s.time - learned_at_ >= kSettleS;
  s.learning = !settled_;
}

// A source of one sensor counts for it; of a recording's sensors the tracking tells what came.
void Publisher::tell_sensors(const std::vector<std::unique_ptr<SourceThread>>& sources) {
  for (std::size_t i = 0; i < snapshot_->sensors.size(); ++i) {
    SensorStatus& status = snapshot_->sensors[i];
    const TrackedSensor& tracked = report_->sensors[i];
    status.frames = tracked.received - tracked.unused - tracked.damaged;
    status.damaged = tracked.damaged;
    status.dropped = tracked.unused;
    status.skew_ms = tracked.skew_ms;
    status.latency_ms = tracked.latency_ms;
    status.last_good = tracked.last_good;
    status.background_share = tracked.background_share;
    status.stereo = tracked.stereo;
    for (const auto& source : sources) {
      const auto& indices = source->rig_index();
      const auto own = [&](std::uint8_t index) { return index == i; };
      const auto any = [](std::uint8_t index) { return index != FrameSource::kNone; };
      if (std::none_of(indices.begin(), indices.end(), own)) continue;
      const SourceThread::Counters counters = source->counters();
      if (std::count_if(indices.begin(), indices.end(), any) == 1) {
        status.dropped += counters.dropped;
        status.damaged = counters.damaged;  // those among them that were handed on, too
      }
      status.resets = counters.resets;
      status.trouble = source->trouble();
    }
    tell_sensor(i);
  }
}

void Publisher::tell_sensor(std::size_t index) {
  const Snapshot& s = *snapshot_;
  SensorStatus& status = snapshot_->sensors[index];
  const double silent_s = s.time - status.last_good;
  if (status.frames == 0) {
    status.state = s.time < kStartS ? SensorState::kStarting : SensorState::kLost;
  } else if (silent_s > kSilentS) {
    status.state = SensorState::kLost;
  } else if (s.learning) {
    status.state = SensorState::kLearning;
  } else if (status.fps < kRateShareMin * status.expected_fps ||
             status.dropped_share > kDroppedShareMax) {
    status.state = SensorState::kDegraded;
  } else {
    status.state = SensorState::kOk;
  }
}

void Publisher::tell_rates() {
  Snapshot& s = *snapshot_;
  Sample now{s.time, s.framesets, s.framesets_dropped, report_->cpu_s, {}, {}};
  for (std::size_t i = 0; i < s.sensors.size(); ++i) {
    now.frames[i] = s.sensors[i].frames;
    now.lost[i] = s.sensors[i].dropped + s.sensors[i].damaged;
  }
  if (samples_.empty() || now.time - samples_.back().time >= 1.0) {
    if (samples_.full()) {
      std::copy(samples_.begin() + 1, samples_.end(), samples_.begin());
      samples_.pop_back();
    }
    // The start has no rate: what comes before the first frame does not count.
    if (now.framesets == 0) samples_.clear();
    samples_.push_back(now);
  }
  const Sample& then = samples_[0];
  const double span_s = now.time - then.time;
  if (span_s < 0.5) return;
  s.frameset_rate = static_cast<double>(now.framesets - then.framesets) / span_s;
  s.framesets_dropped_share =
      share(now.framesets_dropped - then.framesets_dropped, now.framesets - then.framesets);
  s.pipeline_cpu_share = (now.cpu_s - then.cpu_s) / span_s;
  for (std::size_t i = 0; i < s.sensors.size(); ++i) {
    const std::uint64_t frames = now.frames[i] - then.frames[i];
    const std::uint64_t lost = now.lost[i] - then.lost[i];
    s.sensors[i].fps = static_cast<double>(frames) / span_s;
    s.sensors[i].dropped_share = share(lost, frames);
  }
}

void Publisher::tell_drift(const DriftWatch& drift) {
  if (!drift.report(drift_)) return;
  CalibrationStatus& calibration = snapshot_->calibration;
  if (drift_.notes != told_notes_) log_.say(Severity::kNote, drift_.note.view());
  if (drift_.alarm != calibration.drift_alarm)
    log_.say(drift_.alarm ? Severity::kWarning : Severity::kNote,
             drift_.alarm ? fmt::format("Moved since the calibration: {}", drift_.text.view())
                          : std::string("The sensors stand again as they were calibrated."));
  told_notes_ = drift_.notes;
  calibration.drift_alarm = drift_.alarm;
  calibration.drift_text = drift_.text;
}

void Publisher::tell_stages() {
  Snapshot& s = *snapshot_;
  if (s.framesets == 0 || s.time - stages_told_at_ < 1.0) return;
  stages_told_at_ = s.time;
  const std::size_t size = std::min<std::size_t>(s.framesets, TrackingReport::kTimings);
  for (std::size_t i = 0; i < kStageCount; ++i) {
    auto times = report_->stage_ms[i];
    s.stages[i].last_ms = static_cast<double>(times[(s.framesets - 1) % TrackingReport::kTimings]);
    std::sort(times.begin(), times.begin() + static_cast<std::ptrdiff_t>(size));
    s.stages[i].p50_ms = static_cast<double>(times[size / 2]);
    s.stages[i].p99_ms = static_cast<double>(times[size * 99 / 100]);
  }
}

void Publisher::tell_unit(const FramePool& pool) {
  Snapshot& s = *snapshot_;
  s.slots_in_use = static_cast<std::uint32_t>(pool.in_use());
  s.slots_high_water = static_cast<std::uint32_t>(pool.high_water());
  s.slots_capacity = static_cast<std::uint32_t>(pool.capacity());
  s.allocations_sealed = sealed_allocations();
  s.page_faults = report_->page_faults;
  s.resident_bytes = resident_bytes();
}

void Publisher::log_recording() {
  const RecordingStatus& now = snapshot_->recording;
  if (now.state == told_recording_) return;
  told_recording_ = now.state;
  const std::string trouble(now.trouble.view());
  switch (now.state) {
    case RecordingState::kOn:
      log_.say(Severity::kWarning, "Everything that the sensors see is being recorded.");
      break;
    case RecordingState::kNoDisk:
      log_.say(Severity::kError, fmt::format("The recording cannot be written: {}", trouble));
      break;
    case RecordingState::kOff:
      log_.say(Severity::kNote,
               fmt::format("The recording ended with {} frames in {} files, {} dropped. {}",
                           now.frames, now.files, now.dropped, trouble));
  }
}

void Publisher::log_changes() {
  const Snapshot& s = *snapshot_;
  for (std::size_t i = 0; i < s.sensors.size(); ++i) {
    const SensorState state = s.sensors[i].state;
    if (state == told_states_[i]) changed_at_[i] = s.time;
    // A state that comes and goes is on the page and in the metrics; the log is for what lasts.
    if (s.time - changed_at_[i] < kLastingS) continue;
    const bool bad = state == SensorState::kLost || state == SensorState::kDegraded;
    log_.say(bad ? Severity::kWarning : Severity::kNote,
             fmt::format("Sensor {} is {} (was {}).", s.sensors[i].name.view(), to_text(state),
                         to_text(told_states_[i])));
    told_states_[i] = state;
  }
  log_recording();
  if (told_learning_ && !s.learning && s.framesets > 0) {
    log_.say(Severity::kNote, "The empty wagon is known; people are counted from now on.");
    told_learning_ = false;
  }
}

}  // namespace wagonsight
