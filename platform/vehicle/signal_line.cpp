#include "vehicle/signal_line.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

namespace wagonsight {
namespace {

constexpr double kSpeedMax = 200;  // m/s; faster than any train

bool is_printable(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c >= ' ' && c <= '~'; });
}

Result<VehicleSignal> parse_speed(std::string_view text) {
  VehicleSignal signal;
  const char* end = text.data() + text.size();
  const auto read = std::from_chars(text.data(), end, signal.speed);
  if (read.ec != std::errc{} || read.ptr != end) return fail("the speed is not a number");
  if (!(signal.speed >= 0 && signal.speed <= kSpeedMax))
    return fail("the speed is not between 0 and 200 m/s");
  return signal;
}

Result<VehicleSignal> parse_door(std::string_view text, std::span<const Name> doors) {
  VehicleSignal signal;
  signal.kind = VehicleSignal::Kind::kDoor;
  const auto space = text.rfind(' ');
  if (space == std::string_view::npos) return fail("a door needs a name and open or closed");
  const std::string_view state = text.substr(space + 1);
  if (state != "open" && state != "closed") return fail("a door is open or closed");
  signal.door_state = state == "open" ? DoorState::kOpen : DoorState::kClosed;
  const auto* door = std::find(doors.data(), doors.data() + doors.size(), text.substr(0, space));
  signal.door = static_cast<std::size_t>(door - doors.data());
  if (signal.door == doors.size()) return fail("the settings name no such door");
  return signal;
}

Result<VehicleSignal> parse_stop(std::string_view text) {
  VehicleSignal signal;
  signal.kind = VehicleSignal::Kind::kStop;
  if (text.empty()) return fail("a stop needs a name, or - when it was left");
  if (text.size() > Name::capacity()) return fail("the stop's name is too long");
  if (text != "-") signal.stop = text;
  return signal;
}

}  // namespace

Result<VehicleSignal> parse_signal_line(std::string_view line, std::span<const Name> doors) {
  if (!is_printable(line)) return fail("it is not printable ASCII");
  const std::string_view word = line.substr(0, line.find(' '));
  const std::string_view rest = line.substr(std::min(line.size(), word.size() + 1));
  if (word == "speed") return parse_speed(rest);
  if (word == "door") return parse_door(rest, doors);
  if (word == "stop") return parse_stop(rest);
  return fail("it begins with none of speed, door, stop");
}

}  // namespace wagonsight
