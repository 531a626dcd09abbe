#pragma once

#include <array>
#include <cstdint>
#include <type_traits>

#include "base/capacities.h"
#include "base/fixed_string.h"
#include "base/fixed_vector.h"

// What is told of the unit itself and does not change while it runs; flat, like a Snapshot, so that
// it can lie beside it in shared memory. No secret is ever in here. World frame W, metres, radians.
namespace wagonsight {

struct PlanZone {
  Name name;
  std::uint32_t capacity = 0;  // people; 0: not stated
  FixedVector<std::array<double, 2>, kZoneCornersMax> polygon;
};
struct PlanSeat {
  Name name;
  std::array<double, 2> position{};
  double yaw = 0;  // direction a sitter looks, from +x
  double width = 0.5;
};
struct PlanDoor {
  Name name;
  std::array<double, 2> from{}, to{};
};
struct PlanArea {  // a mask volume as seen from above: a window, a screen
  Name name;
  std::array<double, 2> min{}, max{};
};
struct PlanSensor {
  Name name;
  std::array<double, 3> position{};
  std::array<double, 2>
      looks{};            // its optical axis on the floor, unit length or zero when vertical
  double view_angle = 0;  // horizontal, whole
  double range = 0;
};

// The wagon as a drawing seen from above.
struct Plan {
  std::array<double, 3> inside_min{}, inside_max{};
  FixedVector<PlanZone, kZonesMax> zones;
  FixedVector<PlanSeat, kSeatsMax> seats;
  FixedVector<PlanDoor, kDoorsMax> doors;
  FixedVector<PlanArea, kMasksMax> masks;
  FixedVector<PlanSensor, kSensorsMax> sensors;
};

// How the daemon's run before this one ended, when it did not end as it should.
struct LastCrash {
  bool present = false;
  double before_start_s = 0;  // from the last sign of life of that run to the start of this one
  double unix_time = 0;       // of that sign; 0: unsynchronised
  std::uint32_t recent = 0;   // crashes within three minutes, this one included
  FixedString<200> reason;
};

struct UnitInfo {
  Name name;                 // of the unit or its wagon, as the settings say
  FixedString<80> version;   // of the program
  bool simulated = false;    // the frames come from the simulator
  bool has_barrier = false;  // frames are grouped by a barrier: skews are what they happen to be
  bool safe_mode = false;    // it crashed too often, and only tells how it is
  LastCrash last_crash;
  double started_unix = 0;           // 0: the clock was not synchronised then
  std::uint64_t resident_limit = 0;  // bytes the daemon is meant to stay below; 0: none stated
  std::uint16_t recording_minutes_max = 0;  // 0: it cannot record
  Plan plan;
  FixedString<16'384> settings;  // the settings file, its secrets removed
};
static_assert(std::is_trivially_copyable_v<UnitInfo>, "a UnitInfo lives in shared memory");

// The last things the daemon had to say, oldest first.
enum class Severity : std::uint8_t { kNote, kWarning, kError };
struct LogLine {
  double time = 0;       // seconds since the daemon's start
  double unix_time = 0;  // 0 when unsynchronised
  Severity severity = Severity::kNote;
  FixedString<240> text;
};
struct LogTail {
  FixedVector<LogLine, 128> lines;
};

}  // namespace wagonsight
