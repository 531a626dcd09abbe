#include "snapshot/json_lines.h"

#include <array>
#include <cstddef>

#include "snapshot/json_text.h"

namespace wagonsight {
namespace {

constexpr int kTimeDecimals = 6;  // a microsecond
constexpr int kMetreDecimals = 4;
constexpr int kQuaternionDecimals = 6;  // 4 would turn a 4 m lever by 0.4 mm
constexpr int kMillisecondDecimals = 3;

template <class Number, std::size_t N>
void append_array(std::string& out, const std::array<Number, N>& values, int decimals) {
  out += '[';
  for (std::size_t i = 0; i < N; ++i) {
    if (i != 0) out += ',';
    append_number(out, static_cast<double>(values[i]), decimals);
  }
  out += ']';
}

template <std::size_t N>
bool is_zero(const std::array<double, N>& values) {
  return values == std::array<double, N>{};
}

void append_shape(const Person& person, std::string& out) {
  if (!is_zero(person.box.size)) {
    out += R"(,"box":{"center":)";
    append_array(out, person.box.center, kMetreDecimals);
    out += R"(,"size":)";
    append_array(out, person.box.size, kMetreDecimals);
    out += R"(,"yaw":)";
    append_number(out, person.box.yaw, kMetreDecimals);
    out += '}';
  }
  if (!is_zero(person.ellipsoid.semi_axes)) {
    out += R"(,"ellipsoid":{"center":)";
    append_array(out, person.ellipsoid.center, kMetreDecimals);
    out += R"(,"semi_axes":)";
    append_array(out, person.ellipsoid.semi_axes, kMetreDecimals);
    out += R"(,"rotation":)";
    append_array(out, person.ellipsoid.rotation, kQuaternionDecimals);
    out += '}';
  }
}

void append_points(const Person& person, std::string& out) {
  if (person.has_head) {
    out += R"(,"head":)";
    append_array(out, person.head, kMetreDecimals);
  }
  if (person.has_shoulders) {
    out += R"(,"shoulders":[)";
    append_array(out, person.shoulder_left, kMetreDecimals);
    out += ',';
    append_array(out, person.shoulder_right, kMetreDecimals);
    out += ']';
  }
}

void append_views(const Person& person, std::string& out) {
  if (person.views.empty()) return;
  out += R"(,"views":[)";
  for (const ViewAttributes& view : person.views) {
    if (out.back() == '}') out += ',';
    out += R"({"sensor_index":)";
    append_integer(out, static_cast<unsigned>(view.sensor_index));
    out += R"(,"pixels":)";
    append_integer(out, view.pixels);
    out += R"(,"image_box":)";
    append_array(out, view.image_box, 0);
    out += R"(,"distance":)";
    append_number(out, static_cast<double>(view.distance), kMetreDecimals);
    out += R"(,"visible_share":)";
    append_number(out, static_cast<double>(view.visible_share), kMetreDecimals);
    out += '}';
  }
  out += ']';
}

}  // namespace

void append_person(const Person& person, bool with_sigma, std::string& out) {
  out += R"({"id":)";
  append_integer(out, person.id);
  out += R"(,"position":)";
  append_array(out, person.position, kMetreDecimals);
  out += R"(,"height":)";
  append_number(out, person.height, kMetreDecimals);
  out += R"(,"posture":")";
  out += to_text(person.posture);
  out += R"(","velocity":)";
  append_array(out, person.velocity, kMetreDecimals);
  if (with_sigma) {
    out += R"(,"sigma":)";
    append_array(out, person.sigma, kMetreDecimals);
  }
  append_shape(person, out);
  append_points(person, out);
  append_views(person, out);
  if (with_sigma) {  // of a track; truth has none
    out += R"(,"since":)";
    append_number(out, person.since, kTimeDecimals);
    out += R"(,"last_seen":)";
    append_number(out, person.last_seen, kTimeDecimals);
  }
  out += '}';
}

void append_event(const Event& event, std::string& out) {
  out += R"({"kind":")";
  out += to_text(event.kind);
  out += R"(","person":)";
  append_integer(out, event.person);
  out += R"(,"since":)";
  append_number(out, event.since, kTimeDecimals);
  out += R"(,"evidence":)";
  append_quoted(out, event.evidence.view());
  out += '}';
}

void append_people_line(const PeopleFrame& frame, bool with_sigma, std::string& out) {
  out += R"({"time":)";
  append_number(out, frame.time, kTimeDecimals);
  out += R"(,"people":[)";
  for (std::size_t i = 0; i < frame.people.size(); ++i) {
    if (i != 0) out += ',';
    append_person(frame.people[i], with_sigma, out);
  }
  out += R"(],"events":[)";
  for (std::size_t i = 0; i < frame.events.size(); ++i) {
    if (i != 0) out += ',';
    append_event(frame.events[i], out);
  }
  out += R"(],"skew_ms":{)";
  for (std::size_t i = 0; i < frame.skews.size(); ++i) {
    if (i != 0) out += ',';
    append_quoted(out, frame.skews[i].sensor.view());
    out += ':';
    append_number(out, frame.skews[i].skew_ms, kMillisecondDecimals);
  }
  out += "}}";
}

std::string_view to_text(Posture posture) {
  switch (posture) {
    case Posture::kStanding:
      return "standing";
    case Posture::kSitting:
      return "sitting";
    case Posture::kLying:
      return "lying";
    case Posture::kUnknown:
      break;
  }
  return "unknown";
}

std::string_view to_text(EventKind kind) {
  switch (kind) {
    case EventKind::kFall:
      return "fall";
    case EventKind::kMotionless:
      return "motionless";
    case EventKind::kCrowding:
      return "crowding";
    case EventKind::kRunning:
      return "running";
    case EventKind::kCounterFlow:
      return "counter_flow";
    case EventKind::kLeftObject:
      return "left_object";
    case EventKind::kBoarding:
      return "boarding";
    case EventKind::kAlighting:
      return "alighting";
  }
  return "unknown";
}

std::string_view to_text(Occupied state) {
  switch (state) {
    case Occupied::kFree:
      return "free";
    case Occupied::kOccupied:
      return "occupied";
    case Occupied::kUnobserved:
      break;
  }
  return "unobserved";
}

std::string_view to_text(RecordingState state) {
  switch (state) {
    case RecordingState::kOff:
      return "off";
    case RecordingState::kOn:
      return "on";
    case RecordingState::kNoDisk:
      break;
  }
  return "no disk";
}

std::string_view to_text(ThermalBand band) {
  switch (band) {
    case ThermalBand::kNormal:
      return "normal";
    case ThermalBand::kWarm:
      return "warm";
    case ThermalBand::kHot:
      break;
  }
  return "hot";
}

std::string_view to_text(SensorState state) {
  switch (state) {
    case SensorState::kStarting:
      return "starting";
    case SensorState::kLearning:
      return "learning";
    case SensorState::kOk:
      return "ok";
    case SensorState::kDegraded:
      return "degraded";
    case SensorState::kLost:
      break;
  }
  return "lost";
}

}  // namespace wagonsight
