#include "status/health.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "snapshot/json_lines.h"

namespace wagonsight {
namespace {

class Assessment {
 public:
  explicit Assessment(Health& health) : health_(health) {}

  void fault(std::string_view id, std::string_view subject, Verdict weight, std::string cause,
             std::string next_action) {
    health_.faults.push_back(
        {std::string(id), std::string(subject), weight, std::move(cause), std::move(next_action)});
  }
  void check(std::string name, bool passed, std::string detail) {
    health_.checks.push_back({std::move(name), passed, std::move(detail)});
  }

 private:
  Health& health_;
};

std::string duration_text(double seconds) {
  if (seconds < 120) return fmt::format("{:.0f} s", std::max(0.0, seconds));
  if (seconds < 7200) return fmt::format("{:.0f} min", seconds / 60);
  return fmt::format("{:.0f} h", seconds / 3600);
}

bool is_running(const SensorStatus& sensor) {
  return sensor.state == SensorState::kOk || sensor.state == SensorState::kDegraded ||
         sensor.state == SensorState::kLearning;
}

// The first instants draw up the background and lose frames by it; that is told as learning.
bool is_judged(const SensorStatus& sensor) {
  return is_running(sensor) && sensor.state != SensorState::kLearning;
}

bool is_slow(const SensorStatus& sensor, const HealthLimits& limits) {
  return is_judged(sensor) && sensor.expected_fps > 0 &&
         sensor.fps < limits.rate_share_min * sensor.expected_fps;
}

// One fault a sensor: what lacks frames also drops them and is out of step.
void judge_sensor_rate(Assessment& out, const SensorStatus& sensor, const HealthLimits& limits) {
  const std::string name(sensor.name.view());
  if (is_slow(sensor, limits)) {
    out.fault(
        "sensor_rate_low", name, Verdict::kDegraded,
        fmt::format("Sensor {} gives {:.1f} instead of {:.0f} frames a second.", name, sensor.fps,
                    sensor.expected_fps),
        "Check that the sensor has a USB or 1394 bus of its own and that its cable is whole.");
  } else if (sensor.dropped_share > limits.dropped_share_max) {
    out.fault("sensor_drops", name, Verdict::kDegraded,
              fmt::format("Sensor {} lost {:.1f}% of its frames in the last ten seconds.", name,
                          100 * sensor.dropped_share),
              "Look at the stage timings: if they are within 33 ms, check the cable and the bus.");
  } else if (std::abs(sensor.skew_ms) > limits.skew_ms_max) {
    out.fault(
        "sensor_skew", name, Verdict::kDegraded,
        fmt::format("Sensor {} is {:.1f} ms away from the common instant.", name, sensor.skew_ms),
        "Restart the unit; if it stays, the sensor's clock drifts and it needs replacing.");
  }
}

// Several slow sensors at once are not the sensors' fault.
bool judge_overload(Assessment& out, const Snapshot& snapshot, const HealthLimits& limits) {
  std::size_t slow = 0;
  double fps_least = 1e9, fps_most = 0;
  for (const SensorStatus& sensor : snapshot.sensors) {
    if (!is_slow(sensor, limits)) continue;
    ++slow;
    fps_least = std::min(fps_least, sensor.fps);
    fps_most = std::max(fps_most, sensor.fps);
  }
  if (slow < 2 || 2 * slow <= snapshot.sensors.size()) return false;
  out.fault("overload", "", Verdict::kDegraded,
            fmt::format("{} of {} sensors give too few frames, {:.0f} to {:.0f} a second: the "
                        "computer does not keep up.",
                        slow, snapshot.sensors.size(), fps_least, fps_most),
            "Stop what else runs on this computer; if nothing does, fetch the diagnostics.");
  return true;
}

// What the driver found out is closer to the cause than what the missing frames tell.
void judge_trouble(Assessment& out, const SensorStatus& sensor, const std::string& since) {
  const std::string name(sensor.name.view());
  const std::string_view trouble = sensor.trouble.view();
  const auto parting = std::min(trouble.find("; "), trouble.size());
  std::string action(trouble.substr(std::min(parting + 2, trouble.size())));
  if (action.empty()) action = "It is taken up again by itself; if it stays, check its cable";
  action[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(action[0])));
  const bool is_lost = sensor.state == SensorState::kLost;
  out.fault(is_lost ? "sensor_lost" : "sensor_trouble", name, Verdict::kDegraded,
            is_lost ? fmt::format("Sensor {} {}: {}.", name, since, trouble.substr(0, parting))
                    : fmt::format("Sensor {}: {}.", name, trouble.substr(0, parting)),
            action + ".");
}

void judge_sensor(Assessment& out, const Snapshot& snapshot, const SensorStatus& sensor,
                  const HealthLimits& limits, bool overloaded) {
  const std::string name(sensor.name.view());
  if (sensor.state == SensorState::kLost) {
    const std::string since = sensor.frames == 0
                                  ? std::string("has never given a frame")
                                  : fmt::format("has been silent for {}",
                                                duration_text(snapshot.time - sensor.last_good));
    if (!sensor.trouble.empty()) {
      judge_trouble(out, sensor, since);
    } else {
      out.fault("sensor_lost", name, Verdict::kDegraded, fmt::format("Sensor {} {}.", name, since),
                fmt::format("Check the cable and the power of {}; it is taken up again by itself.",
                            name));
    }
  } else if (!sensor.trouble.empty()) {
    judge_trouble(out, sensor, "");
  } else if (is_judged(sensor) && !overloaded) {
    judge_sensor_rate(out, sensor, limits);
  }
  if (sensor.stereo.misaligned)
    out.fault(
        "stereo_misaligned", name, Verdict::kDegraded,
        fmt::format("The two imagers of {} see rows that are {:.1f} pixels apart, so its depth "
                    "cannot be trusted.",
                    name, std::abs(sensor.stereo.row_offset_px)),
        fmt::format("Calibrate {} again; if it comes back, an imager is loose and the camera "
                    "needs replacing.",
                    name));
  if (sensor.stereo.unusable_s > limits.unusable_s_max)
    out.fault("stereo_unusable", name, Verdict::kDegraded,
              fmt::format("The images of {} have been too dark or too bright to match for {}.",
                          name, duration_text(sensor.stereo.unusable_s)),
              fmt::format("Check that nothing covers the lenses of {} and that no lamp shines into "
                          "them.",
                          name));
  if (sensor.has_temperature && sensor.temperature_c > limits.temperature_c_max)
    out.fault("sensor_hot", name, Verdict::kDegraded,
              fmt::format("Sensor {} has {:.0f} degrees Celsius.", name, sensor.temperature_c),
              "Clear its air vents and check the wagon's air conditioning.");
  if (sensor.rms_px > limits.calibration_rms_px_max)
    out.fault("calibration_poor", name, Verdict::kDegraded,
              fmt::format("Sensor {} was calibrated to {:.2f} pixels only.", name, sensor.rms_px),
              "Calibrate again with more views of the board.");
  out.check(fmt::format("sensor {}", name), is_running(sensor),
            fmt::format("{}, {:.1f} of {:.0f} fps", to_text(sensor.state), sensor.fps,
                        sensor.expected_fps));
}

void judge_sensors(Assessment& out, const Snapshot& snapshot, const HealthLimits& limits) {
  const bool overloaded = judge_overload(out, snapshot, limits);
  for (const SensorStatus& sensor : snapshot.sensors)
    judge_sensor(out, snapshot, sensor, limits, overloaded);
  if (snapshot.sensors.empty()) {
    out.fault("no_sensor", "", Verdict::kFailed, "No sensor is configured.",
              "Run `wagonsight devices` and paste its lines into the configuration.");
    return;
  }
  const auto lost = [](const SensorStatus& s) { return s.state == SensorState::kLost; };
  if (std::all_of(snapshot.sensors.begin(), snapshot.sensors.end(), lost))
    out.fault("all_sensors_lost", "", Verdict::kFailed, "No sensor gives frames.",
              "Check the power of the sensors first, then the unit's USB and 1394 buses.");
}

void judge_pipeline(Assessment& out, const Snapshot& snapshot, const HealthLimits& limits) {
  const double age_s = snapshot.time - snapshot.frame.time;
  const bool fresh = snapshot.framesets > 0 && age_s <= limits.frame_age_s_max;
  const bool starting = snapshot.framesets == 0 && snapshot.time <= limits.start_s_max;
  if (starting)
    out.fault("starting", "", Verdict::kDegraded,
              "The unit is starting: its sensors have not given a common frame yet.",
              "Wait a few seconds.");
  if (!fresh && !starting && snapshot.time > limits.frame_age_s_max)
    out.fault("pipeline_late", "", Verdict::kFailed,
              snapshot.framesets == 0
                  ? std::string("No frame has been worked on yet.")
                  : fmt::format("The newest answer is {} old.", duration_text(age_s)),
              "If the sensors give frames, fetch the diagnostics and restart the unit.");
  if (!snapshot.learning && snapshot.framesets_dropped_share > limits.dropped_share_max)
    out.fault("pipeline_drops", "", Verdict::kDegraded,
              fmt::format("The pipeline skipped {:.1f}% of the instants of the last ten seconds.",
                          100 * snapshot.framesets_dropped_share),
              "Look at the stage timings for the slow step, and stop what else runs on the unit.");
  if (snapshot.learning && !starting)
    out.fault("learning", "", Verdict::kDegraded,
              "The empty wagon is still being learned, so nobody is counted yet.",
              "Wait a few seconds; if people stand still in view, ask them to move.");
  out.check("pipeline", fresh, fmt::format("{:.1f} instants a second", snapshot.frameset_rate));
  out.check("background", !snapshot.learning, snapshot.learning ? "learning" : "known");
}

// Whoever is in the wagon has a right to know; the tracking does not suffer by it.
void judge_recording(Assessment& out, const Snapshot& snapshot) {
  const RecordingStatus& recording = snapshot.recording;
  const std::string trouble(recording.trouble.view());
  if (recording.state == RecordingState::kOn)
    out.fault("recording", "", Verdict::kOk,
              fmt::format("Everything that the sensors see is being recorded, for {} more.",
                          duration_text(recording.ends_in_s)),
              "Nothing; it ends by itself, or sooner by DELETE /api/v1/recording.");
  if (recording.state == RecordingState::kNoDisk)
    out.fault("recording_failed", "", Verdict::kOk,
              fmt::format("A recording is on, but cannot be written: {}", trouble),
              "Check the disk; it is tried again every second, and the tracking goes on.");
  if (recording.state == RecordingState::kOff && !trouble.empty())
    out.fault("recording_ended", "", Verdict::kOk,
              fmt::format("The last recording did not last its time. {}", trouble),
              "Take the recordings away, then start another.");
  if (recording.dropped > 0)
    out.fault("recording_drops", "", Verdict::kOk,
              fmt::format("The recording lacks {} frames for which the disk was too slow.",
                          recording.dropped),
              "Record to a faster disk, or fewer sensors.");
}

void judge_temperature(Assessment& out, const Snapshot& snapshot) {
  const ThermalStatus& thermal = snapshot.thermal;
  if (!thermal.present) return;
  if (thermal.band != ThermalBand::kNormal)
    out.fault(
        "computer_hot", thermal.zone.view(), Verdict::kDegraded,
        fmt::format("The computer has {:.0f} degrees Celsius ({}), so at most {:.0f} instants "
                    "a second are worked on.",
                    thermal.hottest_c, thermal.zone.view(), thermal.rate_limit_hz),
        "Clear its air vents and check the wagon's air conditioning; it returns to the full "
        "rate by itself.");
  out.check("temperature", thermal.band == ThermalBand::kNormal,
            fmt::format("{:.0f} degrees Celsius ({})", thermal.hottest_c, thermal.zone.view()));
}

void judge_calibration(Assessment& out, const Snapshot& snapshot) {
  const CalibrationStatus& calibration = snapshot.calibration;
  if (!calibration.present)
    out.fault("no_calibration", "", Verdict::kDegraded, "The sensors are not calibrated.",
              "Run wagonsight-calibrate and name its file with --rig.");
  if (calibration.drift_alarm)
    out.fault("drift", "", Verdict::kDegraded,
              fmt::format("A sensor has moved since it was calibrated: {}",
                          calibration.drift_text.view()),
              "Fix the sensor's mount, then calibrate again.");
  out.check("calibration", calibration.present,
            std::string(calibration.present ? calibration.source.view() : "none"));
}

void judge_unit(Assessment& out, const Snapshot& snapshot, const UnitInfo& unit) {
  constexpr double kMebibyte = 1024.0 * 1024.0;
  if (unit.resident_limit > 0 && snapshot.resident_bytes > unit.resident_limit)
    out.fault("memory", "", Verdict::kDegraded,
              fmt::format("The daemon uses {:.1f} MB of memory; {:.0f} MB were planned.",
                          static_cast<double>(snapshot.resident_bytes) / kMebibyte,
                          static_cast<double>(unit.resident_limit) / kMebibyte),
              "Fetch the diagnostics and report this; the unit keeps working.");
  if (snapshot.allocations_sealed > 0)
    out.fault("allocation", "", Verdict::kOk,
              fmt::format("The data path allocated memory {} times after start-up.",
                          snapshot.allocations_sealed),
              "Fetch the diagnostics and report this; the unit keeps working.");
  if (snapshot.slots_capacity > 0 && snapshot.slots_in_use == snapshot.slots_capacity)
    out.fault("frame_slots", "", Verdict::kDegraded, "Every frame buffer is in use.",
              "Look at the stage timings: the pipeline does not keep up with the sensors.");
  if (snapshot.unix_time <= 0)
    out.fault("time_unsynchronised", "", Verdict::kOk,
              "The unit's clock is not synchronised, so times are counted from its start.",
              "Connect the unit to the train's time server.");
}

void judge_freshness(Assessment& out, const StatusInput& input, const HealthLimits& limits) {
  const bool published = input.snapshot != nullptr;
  const bool fresh = published && input.snapshot_age_s <= limits.snapshot_age_s_max;
  if (!fresh)
    out.fault("daemon_silent", "", Verdict::kFailed,
              published ? fmt::format("The daemon has said nothing for {}.",
                                      duration_text(input.snapshot_age_s))
                        : std::string("The daemon has not said anything yet."),
              "Wait for the watchdog to restart it; if it does not, cycle the unit's power.");
  out.check("daemon", fresh, fresh ? "publishes" : "silent");
}

void judge_last_crash(Assessment& out, const Snapshot& snapshot, const UnitInfo& unit) {
  const LastCrash& crash = unit.last_crash;
  if (unit.safe_mode) {
    out.fault("safe_mode", "", Verdict::kFailed,
              fmt::format("The daemon crashed {} times within three minutes, the last time: {}; it "
                          "does not watch the wagon now and only says so.",
                          crash.recent, crash.reason.view()),
              "Fetch the diagnostics and report this; it tries again by itself in a few minutes.");
  } else if (crash.present) {
    out.fault("restarted", "", Verdict::kOk,
              fmt::format("The daemon was started again {} ago after a crash: {}.",
                          duration_text(crash.before_start_s + snapshot.time), crash.reason.view()),
              "Fetch the diagnostics and report this; the unit works again.");
  }
}

std::string plain_words(const Health& health, const StatusInput& input) {
  if (health.verdict != Verdict::kOk) return health.faults.front().cause;
  const Snapshot& snapshot = *input.snapshot;
  const std::size_t sensors = snapshot.sensors.size();
  const std::uint32_t people = snapshot.occupancy.count;
  return fmt::format("{} sensor{} watch{} the wagon; {} {} inside.", sensors,
                     sensors == 1 ? "" : "s", sensors == 1 ? "es" : "", people,
                     people == 1 ? "person is" : "people are");
}

}  // namespace

std::string_view to_text(Verdict verdict) {
  switch (verdict) {
    case Verdict::kOk:
      return "ok";
    case Verdict::kDegraded:
      return "degraded";
    case Verdict::kFailed:
      break;
  }
  return "failed";
}

Health assess(const StatusInput& input, const HealthLimits& limits) {
  Health health;
  Assessment out(health);
  judge_freshness(out, input, limits);
  if (input.snapshot != nullptr) judge_last_crash(out, *input.snapshot, *input.unit);
  if (input.snapshot != nullptr && !input.unit->safe_mode) {
    HealthLimits sensor_limits = limits;
    if (input.unit->has_barrier) sensor_limits.skew_ms_max = 1e9;  // nobody's fault
    judge_sensors(out, *input.snapshot, sensor_limits);
    judge_pipeline(out, *input.snapshot, limits);
    judge_recording(out, *input.snapshot);
    judge_temperature(out, *input.snapshot);
    judge_calibration(out, *input.snapshot);
    judge_unit(out, *input.snapshot, *input.unit);
  }
  std::stable_sort(health.faults.begin(), health.faults.end(),
                   [](const Fault& a, const Fault& b) { return a.weight > b.weight; });
  if (!health.faults.empty()) health.verdict = health.faults.front().weight;
  health.sentence = plain_words(health, input);
  // A lost sensor degrades, and the others go on; without calibration people are still found.
  health.ready =
      input.snapshot != nullptr && health.verdict != Verdict::kFailed && !input.snapshot->learning;
  return health;
}

}  // namespace wagonsight
