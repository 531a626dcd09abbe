#include <fmt/format.h>
#include <sys/random.h>

#include <cmath>

#include "http/server.h"
#include "linux/clocks.h"
#include "unit.h"

namespace wagonsight {
namespace {

// What the daemon is meant to stay below with four Kinects; a simulated wagon comes on top, so
// nothing is promised then.
constexpr std::uint64_t kResidentLimit = std::uint64_t{64} << 20U;

PlanSensor plan_sensor(const RigSensor& sensor) {
  PlanSensor out;
  out.name = sensor.name;
  const Eigen::Vector3d& p = sensor.X_WS.position;
  out.position = {p.x(), p.y(), p.z()};
  const Eigen::Vector3d axis = sensor.X_WS.rotation * Eigen::Vector3d::UnitZ();
  const double flat = std::hypot(axis.x(), axis.y());
  if (flat > 0.05) out.looks = {axis.x() / flat, axis.y() / flat};
  out.view_angle = 2 * std::atan2(0.5 * sensor.camera.width, sensor.camera.fx);
  out.range = sensor.trim_far;
  return out;
}

Plan plan_of(const Wagon& wagon, const Rig& rig) {
  Plan plan;
  const auto point = [](const Eigen::Vector3d& p) { return std::array{p.x(), p.y(), p.z()}; };
  plan.inside_min = point(wagon.inside.min);
  plan.inside_max = point(wagon.inside.max);
  for (const Zone& zone : wagon.zones) {
    PlanZone out;
    out.name = zone.name;
    out.capacity = static_cast<std::uint32_t>(std::max(zone.capacity, 0));
    out.polygon = zone.polygon;
    plan.zones.push_back(out);
  }
  for (const Seat& seat : wagon.seats)
    plan.seats.push_back({seat.name, seat.position, seat.yaw, seat.width});
  for (const Door& door : wagon.doors) plan.doors.push_back({door.name, door.from, door.to});
  for (const MaskVolume& mask : wagon.masks)
    plan.masks.push_back({mask.name,
                          {mask.bounds.min.x(), mask.bounds.min.y()},
                          {mask.bounds.max.x(), mask.bounds.max.y()}});
  for (const RigSensor& sensor : rig.sensors) plan.sensors.push_back(plan_sensor(sensor));
  return plan;
}

}  // namespace

UnitInfo unit_info(const Unit& unit, std::string_view version) {
  UnitInfo info;
  info.name = unit.settings.unit.name;
  info.version = version;
  info.simulated = unit.simulated;
  info.has_barrier = unit.settings.capture.grouping == "barrier";
  const WallTime wall = wall_now();
  info.started_unix = wall.synchronised ? wall.unix_s : 0;
  info.resident_limit = unit.simulated ? 0 : kResidentLimit;
  const RecordingSettings& recording = unit.settings.recording;
  if (!recording.folder.empty()) {
    info.recording_minutes_max = static_cast<std::uint16_t>(recording.minutes);
    // Planned, too, while it records.
    if (info.resident_limit > 0)
      info.resident_limit += static_cast<std::uint64_t>(recording.memory_mb) << 20U;
  }
  info.plan = plan_of(unit.wagon, unit.rig);
  info.settings = std::string_view(unit.settings_text);
  return info;
}

Result<AccessRules> access_rules(const WebSettings& web) {
  AccessRules rules;
  for (const std::string* token : {&web.read_token, &web.admin_token})
    if (token->size() > Token::capacity())
      return fail(
          fmt::format("settings: web.tokens: are at most {} bytes long", Token::capacity()));
  rules.read_token = std::string_view(web.read_token);
  rules.admin_token = std::string_view(web.admin_token);
  rules.bound_to_loopback = is_loopback_address(web.host);
  rules.trusted_network = web.trusted_network;
  for (const std::string& name : web.host_names)
    if (!rules.host_names.try_push_back(Name(std::string_view(name))))
      return fail(fmt::format("settings: web.host_names: are at most {}",
                              decltype(rules.host_names)::capacity()));
  if (getrandom(rules.key.data(), rules.key.size(), 0) != static_cast<ssize_t>(rules.key.size()))
    return fail("web: the system gives no random numbers for the cookies' key");
  return rules;
}

}  // namespace wagonsight
