#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "base/result.h"
#include "snapshot/snapshot.h"

namespace wagonsight {

// One line of what a train tells; see the README.
struct VehicleSignal {
  enum class Kind : std::uint8_t { kSpeed, kDoor, kStop };
  Kind kind = Kind::kSpeed;
  double speed = 0;      // m/s
  std::size_t door = 0;  // index into the doors' names
  DoorState door_state = DoorState::kUnknown;
  Name stop;  // empty: between stops
};

// `line` without its newline. The Error says what is wrong with it, in a few words. Allocates only
// for the Error.
Result<VehicleSignal> parse_signal_line(std::string_view line, std::span<const Name> doors);

}  // namespace wagonsight
