#include "status/metrics.h"

#include <fmt/format.h>

#include <array>
#include <initializer_list>
#include <iterator>
#include <string_view>
#include <utility>

#include "snapshot/json_lines.h"

namespace wagonsight {
namespace {

using Label = std::pair<std::string_view, std::string_view>;

class MetricsText {
 public:
  // Starts a family; every sample() after it belongs to it.
  void family(std::string_view name, std::string_view type, std::string_view help) {
    name_ = name;
    fmt::format_to(std::back_inserter(text_), "# HELP wagonsight_{} {}\n# TYPE wagonsight_{} {}\n",
                   name, help, name, type);
  }
  void sample(double value, std::initializer_list<Label> labels = {}) {
    text_ += "wagonsight_";
    text_ += name_;
    if (labels.size() > 0) {
      char before = '{';
      for (const auto& [key, label] : labels) {
        text_ += before;
        before = ',';
        text_ += key;
        text_ += "=\"";
        append_label(label);
        text_ += '"';
      }
      text_ += '}';
    }
    fmt::format_to(std::back_inserter(text_), " {}\n", value);
  }
  void gauge(std::string_view name, std::string_view help, double value) {
    family(name, "gauge", help);
    sample(value);
  }
  void counter(std::string_view name, std::string_view help, std::uint64_t value) {
    family(name, "counter", help);
    sample(static_cast<double>(value));
  }
  std::string take() { return std::move(text_); }

 private:
  void append_label(std::string_view label) {
    for (const char c : label) {
      if (c == '\\' || c == '"') text_ += '\\';
      if (c == '\n') {
        text_ += "\\n";
      } else {
        text_ += c;
      }
    }
  }

  std::string name_;
  std::string text_;
};

void tell_health(MetricsText& out, const StatusInput& input, const Health& health) {
  out.family("build_info", "gauge", "The program's version, as a label.");
  out.sample(1, {{"version", input.unit->version.view()}});
  out.family("health_verdict", "gauge", "1 for the verdict of this moment.");
  for (const Verdict verdict : {Verdict::kOk, Verdict::kDegraded, Verdict::kFailed})
    out.sample(health.verdict == verdict ? 1 : 0, {{"verdict", to_text(verdict)}});
  out.gauge("ready", "1 when the whole pipeline runs on plausible frames.", health.ready ? 1 : 0);
  out.family("fault_active", "gauge", "1 for each fault of this moment.");
  for (const Fault& fault : health.faults)
    out.sample(
        1, {{"fault", fault.id}, {"subject", fault.subject}, {"weight", to_text(fault.weight)}});
  out.gauge("snapshot_age_seconds", "Since the daemon last published.", input.snapshot_age_s);
}

template <class Value>
void per_sensor(MetricsText& out, const Snapshot& snapshot, std::string_view name,
                std::string_view type, std::string_view help, Value value) {
  out.family(name, type, help);
  for (const SensorStatus& sensor : snapshot.sensors)
    out.sample(static_cast<double>(value(sensor)), {{"sensor", sensor.name.view()}});
}

void tell_sensors(MetricsText& out, const Snapshot& snapshot) {
  out.family("sensor_state", "gauge", "1 for the state a sensor is in.");
  for (const SensorStatus& sensor : snapshot.sensors)
    for (const SensorState state : {SensorState::kStarting, SensorState::kLearning,
                                    SensorState::kOk, SensorState::kDegraded, SensorState::kLost})
      out.sample(sensor.state == state ? 1 : 0,
                 {{"sensor", sensor.name.view()}, {"state", to_text(state)}});
  using S = const SensorStatus&;
  per_sensor(out, snapshot, "sensor_rate_hertz", "gauge", "Frames a second, last ten seconds.",
             [](S s) { return s.fps; });
  per_sensor(out, snapshot, "sensor_expected_rate_hertz", "gauge", "The rate it is meant to have.",
             [](S s) { return s.expected_fps; });
  per_sensor(out, snapshot, "sensor_frames_total", "counter", "Good frames that were used.",
             [](S s) { return s.frames; });
  per_sensor(out, snapshot, "sensor_frames_dropped_total", "counter",
             "Frames for which there was no buffer or no time.", [](S s) { return s.dropped; });
  per_sensor(out, snapshot, "sensor_frames_damaged_total", "counter",
             "Frames that came with lost packets.", [](S s) { return s.damaged; });
  per_sensor(out, snapshot, "sensor_resets_total", "counter", "Times it was opened anew.",
             [](S s) { return s.resets; });
  per_sensor(out, snapshot, "sensor_skew_seconds", "gauge",
             "Its last frame's instant minus the common one.",
             [](S s) { return s.skew_ms * 1e-3; });
  per_sensor(out, snapshot, "sensor_latency_seconds", "gauge",
             "From the light to the host having the frame.",
             [](S s) { return s.latency_ms * 1e-3; });
  per_sensor(out, snapshot, "sensor_last_good_age_seconds", "gauge", "Since its last good frame.",
             [&](S s) { return snapshot.time - s.last_good; });
  per_sensor(out, snapshot, "sensor_background_ratio", "gauge",
             "Share of its pixels with a known background.",
             [](S s) { return s.background_share; });
  per_sensor(out, snapshot, "sensor_reprojection_error_pixels", "gauge",
             "RMS of its calibration; 0 when unknown.", [](S s) { return s.rms_px; });
  const auto stereo = [&](std::string_view name, std::string_view type, std::string_view help,
                          auto value) {
    out.family(name, type, help);
    for (const SensorStatus& sensor : snapshot.sensors)
      if (sensor.stereo.present)
        out.sample(static_cast<double>(value(sensor.stereo)), {{"sensor", sensor.name.view()}});
  };
  stereo("stereo_matched_ratio", "gauge", "Share of its last image that was matched.",
         [](const StereoStatus& s) { return s.matched_share; });
  stereo("stereo_unusable_frames_total", "counter", "Images too dark or too bright to match.",
         [](const StereoStatus& s) { return s.unusable; });
  stereo("stereo_row_offset_pixels", "gauge", "Between the rows of its two imagers.",
         [](const StereoStatus& s) { return s.row_offset_px; });
  stereo("stereo_shutter_seconds", "gauge", "That the exposure law asks for.",
         [](const StereoStatus& s) { return s.shutter_us * 1e-6; });
  out.family("sensor_temperature_celsius", "gauge", "Of sensors that tell it.");
  for (const SensorStatus& sensor : snapshot.sensors)
    if (sensor.has_temperature) out.sample(sensor.temperature_c, {{"sensor", sensor.name.view()}});
}

void tell_occupancy(MetricsText& out, const Snapshot& snapshot) {
  const Occupancy& occupancy = snapshot.occupancy;
  out.gauge("people", "People inside.", occupancy.count);
  out.gauge("observed_ratio", "Share of the inside's air that is observed.",
            occupancy.observed_share);
  out.family("zone_people", "gauge", "People in a zone.");
  for (const ZoneOccupancy& zone : occupancy.zones)
    out.sample(zone.count, {{"zone", zone.name.view()}});
  out.family("zone_capacity_people", "gauge", "What a zone was stated to hold.");
  for (const ZoneOccupancy& zone : occupancy.zones)
    if (zone.capacity > 0) out.sample(zone.capacity, {{"zone", zone.name.view()}});
  out.family("zone_observed_ratio", "gauge", "Share of a zone's air that is observed.");
  for (const ZoneOccupancy& zone : occupancy.zones)
    out.sample(zone.observed_share, {{"zone", zone.name.view()}});
  out.family("seats", "gauge", "Seats by state.");
  std::array<int, 3> seats{};
  for (const SeatOccupancy& seat : occupancy.seats) ++seats[static_cast<std::size_t>(seat.state)];
  for (const Occupied state : {Occupied::kFree, Occupied::kOccupied, Occupied::kUnobserved})
    out.sample(seats[static_cast<std::size_t>(state)], {{"state", to_text(state)}});
  out.family("door_boarded_total", "counter", "People who came in through a door.");
  for (const DoorCount& door : occupancy.doors)
    out.sample(door.boarded, {{"door", door.name.view()}});
  out.family("door_alighted_total", "counter", "People who left through a door.");
  for (const DoorCount& door : occupancy.doors)
    out.sample(door.alighted, {{"door", door.name.view()}});
}

void tell_pipeline(MetricsText& out, const Snapshot& snapshot) {
  out.gauge("uptime_seconds", "Since the daemon's start.", snapshot.time);
  out.counter("framesets_total", "Instants worked on.", snapshot.framesets);
  out.counter("framesets_dropped_total", "Instants that were skipped.", snapshot.framesets_dropped);
  out.gauge("frameset_rate_hertz", "Instants a second.", snapshot.frameset_rate);
  out.gauge("frame_age_seconds", "Age of the newest answer at publication.",
            snapshot.time - snapshot.frame.time);
  out.gauge("pipeline_latency_seconds", "From the light to the answer.",
            snapshot.pipeline_latency_ms * 1e-3);
  out.gauge("pipeline_cpu_ratio", "Of one core, the pipeline's thread.",
            snapshot.pipeline_cpu_share);
  out.family("stage_duration_seconds", "gauge", "Time of a step of the pipeline.");
  for (const StageTiming& stage : snapshot.stages) {
    out.sample(stage.p50_ms * 1e-3, {{"stage", stage.name.view()}, {"quantile", "0.5"}});
    out.sample(stage.p99_ms * 1e-3, {{"stage", stage.name.view()}, {"quantile", "0.99"}});
  }
  out.gauge("learning", "1 while the background is not known.", snapshot.learning ? 1 : 0);
  const RecordingStatus& recording = snapshot.recording;
  out.gauge("recording", "1 while a recording is written.",
            recording.state == RecordingState::kOff ? 0 : 1);
  out.gauge("recording_dropped_frames", "Frames of this recording, or the last, that were dropped.",
            static_cast<double>(recording.dropped));
}

void tell_temperature(MetricsText& out, const ThermalStatus& thermal) {
  out.counter("framesets_spared_total", "Instants left out because the computer was hot.",
              thermal.spared_instants);
  if (!thermal.present) return;
  out.family("temperature_celsius", "gauge", "Of the computer's hottest zone.");
  out.sample(thermal.hottest_c, {{"zone", thermal.zone.view()}});
  out.gauge("thermal_band", "0 normal, 1 warm, 2 hot: fewer instants are worked on.",
            static_cast<double>(thermal.band));
  out.gauge("thermal_rate_limit_hertz", "Instants a second that are worked on at most; 0: all.",
            thermal.rate_limit_hz);
}

void tell_unit(MetricsText& out, const Snapshot& snapshot) {
  out.gauge("resident_memory_bytes", "Of the daemon.",
            static_cast<double>(snapshot.resident_bytes));
  out.counter("page_faults_total", "Page faults of the data path after its first instant.",
              snapshot.page_faults);
  out.counter("allocations_sealed_total", "Allocations of data threads after start-up.",
              snapshot.allocations_sealed);
  out.gauge("frame_slots_in_use", "Frame buffers in use.", snapshot.slots_in_use);
  out.gauge("frame_slots_high_water", "Most frame buffers ever in use.", snapshot.slots_high_water);
  out.gauge("frame_slots_capacity", "Frame buffers there are.", snapshot.slots_capacity);
  out.counter("web_restarts_total", "Times the web side was started anew.", snapshot.web_restarts);
  out.gauge("time_synchronized", "1 when the wall clock can be trusted.",
            snapshot.unix_time > 0 ? 1 : 0);
  const CalibrationStatus& calibration = snapshot.calibration;
  out.gauge("calibration_present", "1 when the sensors are calibrated.",
            calibration.present ? 1 : 0);
  out.gauge("calibration_created_timestamp_seconds", "Unix time; 0 when unknown.",
            calibration.created_unix);
  out.gauge("georeference_sigma_meters", "Of the georeference; 0 when there is none.",
            calibration.georeference_sigma_m);
  out.gauge("drift_alarm", "1 when a sensor has moved since it was calibrated.",
            calibration.drift_alarm ? 1 : 0);
}

}  // namespace

std::string metrics_text(const StatusInput& input, const Health& health) {
  MetricsText out;
  tell_health(out, input, health);
  if (input.snapshot != nullptr) {
    tell_pipeline(out, *input.snapshot);
    tell_sensors(out, *input.snapshot);
    tell_occupancy(out, *input.snapshot);
    tell_temperature(out, input.snapshot->thermal);
    tell_unit(out, *input.snapshot);
  }
  return out.take();
}

}  // namespace wagonsight
