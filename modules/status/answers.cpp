#include "status/answers.h"

#include <cmath>

#include "snapshot/json_lines.h"

namespace wagonsight::answers {
namespace {

// Figures for people need no seventeen digits.
Json number(double value, int decimals) {
  const double scale = std::pow(10.0, decimals);
  return std::isfinite(value) ? Json(std::round(value * scale) / scale) : Json(nullptr);
}
Json text(std::string_view value) {
  return std::string(value);
}

template <std::size_t N>
Json point(const std::array<double, N>& p) {
  Json list = Json::array();
  for (const double coordinate : p) list.push_back(number(coordinate, 4));
  return list;
}

Json sensor(const SensorStatus& s, double now) {
  Json out;
  out["name"] = text(s.name);
  out["kind"] = text(s.kind);
  out["state"] = text(to_text(s.state));
  out["fps"] = number(s.fps, 2);
  out["expected_fps"] = number(s.expected_fps, 2);
  out["frames"] = s.frames;
  out["dropped"] = s.dropped;
  out["damaged"] = s.damaged;
  out["dropped_share"] = number(s.dropped_share, 5);
  out["resets"] = s.resets;
  out["skew_ms"] = number(s.skew_ms, 3);
  out["latency_ms"] = number(s.latency_ms, 2);
  out["temperature_c"] = s.has_temperature ? number(s.temperature_c, 1) : Json(nullptr);
  out["last_good_age_s"] = s.frames > 0 ? number(now - s.last_good, 3) : Json(nullptr);
  out["background_share"] = number(s.background_share, 3);
  if (s.stereo.present)
    out["stereo"] = {{"matched_share", number(s.stereo.matched_share, 3)},
                     {"unusable_frames", s.stereo.unusable},
                     {"unusable_s", number(s.stereo.unusable_s, 1)},
                     {"shutter_us", number(s.stereo.shutter_us, 0)},
                     {"gain_db", number(s.stereo.gain_db, 1)},
                     {"row_offset_px", number(s.stereo.row_offset_px, 2)},
                     {"misaligned", s.stereo.misaligned}};
  out["rms_px"] = s.rms_px > 0 ? number(s.rms_px, 3) : Json(nullptr);
  out["trouble"] = s.trouble.empty() ? Json(nullptr) : text(s.trouble);
  return out;
}

// How much a count is worth, in one word a display can act on.
std::string_view quality(const Snapshot& snapshot, double observed_share) {
  constexpr double kGood = 0.8, kPartial = 0.3;
  if (snapshot.learning || observed_share < kPartial) return "unknown";
  return observed_share < kGood ? "partial" : "good";
}

Json zones(const Snapshot& snapshot) {
  Json list = Json::array();
  for (const ZoneOccupancy& zone : snapshot.occupancy.zones)
    list.push_back({{"name", text(zone.name)},
                    {"count", zone.count},
                    {"capacity", zone.capacity > 0 ? Json(zone.capacity) : Json(nullptr)},
                    {"observed_share", number(zone.observed_share, 3)},
                    {"quality", text(quality(snapshot, zone.observed_share))}});
  return list;
}

}  // namespace

std::string text_of(const Json& value) {
  return value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Json health(const StatusInput& input, const Health& health) {
  Json faults = Json::array();
  for (const Fault& fault : health.faults)
    faults.push_back(
        {{"id", fault.id},
         {"subject", fault.subject},
         {"weight", fault.weight == Verdict::kOk ? Json("note") : text(to_text(fault.weight))},
         {"cause", fault.cause},
         {"next_action", fault.next_action}});
  Json out;
  out["verdict"] = text(to_text(health.verdict));
  out["sentence"] = health.sentence;
  out["ready"] = health.ready;
  out["faults"] = std::move(faults);
  out["snapshot_age_s"] = number(input.snapshot_age_s, 3);
  out["uptime_s"] = input.snapshot != nullptr ? number(input.snapshot->time, 1) : Json(nullptr);
  out["unix_time"] = input.snapshot != nullptr && input.snapshot->unix_time > 0
                         ? number(input.snapshot->unix_time, 3)
                         : Json(nullptr);
  out["simulated"] = input.unit->simulated;
  return out;
}

Json sensors(const Snapshot& snapshot) {
  Json list = Json::array();
  for (const SensorStatus& s : snapshot.sensors) list.push_back(sensor(s, snapshot.time));
  return {{"sensors", std::move(list)}};
}

Json recording(const Snapshot& snapshot) {
  const RecordingStatus& r = snapshot.recording;
  const bool is_on = r.state != RecordingState::kOff;
  Json out;
  out["state"] = text(to_text(r.state));
  out["ends_in_s"] = is_on ? number(r.ends_in_s, 1) : Json(nullptr);
  out["frames"] = r.frames;
  out["dropped"] = r.dropped;
  out["bytes"] = r.bytes;
  out["files"] = r.files;
  out["trouble"] = r.trouble.empty() ? Json(nullptr) : text(r.trouble);
  return out;
}

Json vehicle(const Snapshot& snapshot, const UnitInfo& unit) {
  const VehicleState& v = snapshot.vehicle;
  Json doors = Json::array();
  for (std::size_t i = 0; i < std::min(v.doors.size(), unit.plan.doors.size()); ++i)
    doors.push_back({{"name", text(unit.plan.doors[i].name)},
                     {"state", v.doors[i] == DoorState::kOpen     ? "open"
                               : v.doors[i] == DoorState::kClosed ? "closed"
                                                                  : "unknown"}});
  Json out;
  out["present"] = v.is_listening;
  out["speed"] = v.has_speed ? number(v.speed, 2) : Json(nullptr);
  out["at_stop"] = v.has_stop ? Json(!v.stop.empty()) : Json(nullptr);
  out["stop"] = v.has_stop && !v.stop.empty() ? text(v.stop) : Json(nullptr);
  out["doors"] = std::move(doors);
  out["lines"] = v.lines;
  out["bad_lines"] = v.bad_lines;
  out["refused_connections"] = v.refused_connections;
  out["last_bad"] = v.last_bad.empty() ? Json(nullptr) : text(v.last_bad);
  return out;
}

Json thermal(const ThermalStatus& thermal) {
  if (!thermal.present) return nullptr;
  return {{"celsius", number(thermal.hottest_c, 1)},
          {"zone", text(thermal.zone)},
          {"band", text(to_text(thermal.band))},
          {"rate_limit_hz",
           thermal.rate_limit_hz > 0 ? number(thermal.rate_limit_hz, 1) : Json(nullptr)},
          {"spared_instants", thermal.spared_instants}};
}

Json pipeline(const Snapshot& snapshot) {
  Json stages = Json::array();
  for (const StageTiming& stage : snapshot.stages)
    stages.push_back({{"name", text(stage.name)},
                      {"last_ms", number(stage.last_ms, 3)},
                      {"p50_ms", number(stage.p50_ms, 3)},
                      {"p99_ms", number(stage.p99_ms, 3)}});
  Json out;
  out["framesets"] = snapshot.framesets;
  out["framesets_dropped"] = snapshot.framesets_dropped;
  out["dropped_share"] = number(snapshot.framesets_dropped_share, 5);
  out["rate_hz"] = number(snapshot.frameset_rate, 2);
  out["latency_ms"] = number(snapshot.pipeline_latency_ms, 2);
  out["frame_age_s"] = number(snapshot.time - snapshot.frame.time, 3);
  out["cpu_share"] = number(snapshot.pipeline_cpu_share, 4);
  out["resident_bytes"] = snapshot.resident_bytes;
  out["allocations_sealed"] = snapshot.allocations_sealed;
  out["page_faults"] = snapshot.page_faults;
  out["slots_in_use"] = snapshot.slots_in_use;
  out["slots_high_water"] = snapshot.slots_high_water;
  out["slots_capacity"] = snapshot.slots_capacity;
  out["web_restarts"] = snapshot.web_restarts;
  out["learning"] = snapshot.learning;
  out["recording"] = recording(snapshot);
  out["thermal"] = thermal(snapshot.thermal);
  out["stages"] = std::move(stages);
  return out;
}

Json calibration(const Snapshot& snapshot) {
  const CalibrationStatus& c = snapshot.calibration;
  Json sensors = Json::array();
  for (const SensorStatus& s : snapshot.sensors)
    sensors.push_back(
        {{"name", text(s.name)}, {"rms_px", s.rms_px > 0 ? number(s.rms_px, 3) : Json(nullptr)}});
  const bool aged = c.created_unix > 0 && snapshot.unix_time > 0;
  Json out;
  out["present"] = c.present;
  out["source"] = text(c.source);
  out["created_unix"] = c.created_unix > 0 ? number(c.created_unix, 0) : Json(nullptr);
  out["age_s"] = aged ? number(snapshot.unix_time - c.created_unix, 0) : Json(nullptr);
  out["sensors"] = std::move(sensors);
  out["georeference"] = {
      {"present", c.has_georeference},
      {"sigma_m", c.has_georeference ? number(c.georeference_sigma_m, 5) : Json(nullptr)}};
  out["drift"] = {{"alarm", c.drift_alarm}, {"text", text(c.drift_text)}};
  return out;
}

Json occupancy(const Snapshot& snapshot) {
  const Occupancy& o = snapshot.occupancy;
  Json seats = Json::array(), doors = Json::array();
  for (const SeatOccupancy& seat : o.seats)
    seats.push_back({{"name", text(seat.name)}, {"state", text(to_text(seat.state))}});
  for (const DoorCount& door : o.doors)
    doors.push_back(
        {{"name", text(door.name)}, {"boarded", door.boarded}, {"alighted", door.alighted}});
  Json out;
  out["time"] = number(snapshot.frame.time, 3);
  out["unix_time"] = snapshot.unix_time > 0 ? number(snapshot.unix_time, 3) : Json(nullptr);
  out["count"] = o.count;
  out["observed_share"] = number(o.observed_share, 3);
  out["quality"] = text(quality(snapshot, o.observed_share));
  out["zones"] = zones(snapshot);
  out["seats"] = std::move(seats);
  out["doors"] = std::move(doors);
  return out;
}

Json plan(const UnitInfo& unit) {
  const Plan& p = unit.plan;
  Json out;
  out["name"] = text(unit.name);
  out["inside"] = {{"min", point(p.inside_min)}, {"max", point(p.inside_max)}};
  out["zones"] = Json::array();
  for (const PlanZone& zone : p.zones) {
    Json polygon = Json::array();
    for (const auto& corner : zone.polygon) polygon.push_back(point(corner));
    out["zones"].push_back(
        {{"name", text(zone.name)}, {"capacity", zone.capacity}, {"polygon", std::move(polygon)}});
  }
  out["seats"] = Json::array();
  for (const PlanSeat& seat : p.seats)
    out["seats"].push_back({{"name", text(seat.name)},
                            {"position", point(seat.position)},
                            {"yaw", number(seat.yaw, 4)},
                            {"width", number(seat.width, 4)}});
  out["doors"] = Json::array();
  for (const PlanDoor& door : p.doors)
    out["doors"].push_back(
        {{"name", text(door.name)}, {"from", point(door.from)}, {"to", point(door.to)}});
  out["masks"] = Json::array();
  for (const PlanArea& mask : p.masks)
    out["masks"].push_back(
        {{"name", text(mask.name)}, {"min", point(mask.min)}, {"max", point(mask.max)}});
  out["sensors"] = Json::array();
  for (const PlanSensor& s : p.sensors)
    out["sensors"].push_back({{"name", text(s.name)},
                              {"position", point(s.position)},
                              {"looks", point(s.looks)},
                              {"view_angle", number(s.view_angle, 4)},
                              {"range", number(s.range, 2)}});
  return out;
}

Json log(const LogTail& log) {
  constexpr std::array<std::string_view, 3> kSeverities = {"note", "warning", "error"};
  Json list = Json::array();
  for (const LogLine& line : log.lines)
    list.push_back({{"time", number(line.time, 3)},
                    {"unix_time", line.unix_time > 0 ? number(line.unix_time, 3) : Json(nullptr)},
                    {"severity", text(kSeverities[static_cast<std::size_t>(line.severity) % 3])},
                    {"text", text(line.text)}});
  return {{"lines", std::move(list)}};
}

Json version(const UnitInfo& unit) {
  return {{"name", "wagonsight"},
          {"version", text(unit.version)},
          {"unit", text(unit.name)},
          {"simulated", unit.simulated},
          {"started_unix", unit.started_unix > 0 ? number(unit.started_unix, 0) : Json(nullptr)}};
}

}  // namespace wagonsight::answers
