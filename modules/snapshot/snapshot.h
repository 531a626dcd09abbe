#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <type_traits>

#include "base/capacities.h"
#include "base/fixed_string.h"
#include "base/fixed_vector.h"

// What is told of an instant. Everything here is flat and free of pointers, so that a Snapshot can
// be copied into shared memory and read by another process. World frame W, metres, seconds,
// radians.
namespace wagonsight {

enum class Posture : std::uint8_t { kUnknown, kStanding, kSitting, kLying };

struct Box {  // upright, turned about z by yaw
  std::array<double, 3> center{};
  std::array<double, 3> size{};
  double yaw = 0;
};

struct Ellipsoid {
  std::array<double, 3> center{};
  std::array<double, 3> semi_axes{};           // descending
  std::array<double, 4> rotation{1, 0, 0, 0};  // w, x, y, z: its axes in W
};

// What one view that saw the person contributes.
struct ViewAttributes {
  std::uint8_t sensor_index = 0;
  std::uint32_t pixels = 0;        // foreground pixels of this person in this view
  std::array<int, 4> image_box{};  // u_min, v_min, u_max, v_max, inclusive
  float distance = 0;              // median depth, metres
  float visible_share = 0;  // of the box's outline in the image, 0..1; see pipeline/seen_share.h
};

struct Person {
  std::uint32_t id = 0;              // never reused while the unit runs
  std::array<double, 2> position{};  // the torso's centre projected to the floor
  double height = 0;  // of the person upright: the highest seen since the track began
  Posture posture = Posture::kUnknown;
  std::array<double, 2> velocity{};
  std::array<double, 2> sigma{};  // standard deviation of position
  Box box;
  Ellipsoid ellipsoid;
  bool has_head = false, has_shoulders = false;
  std::array<double, 3> head{};  // centre of the head
  std::array<double, 3> shoulder_left{}, shoulder_right{};
  FixedVector<ViewAttributes, kSensorsMax> views;
  double since = 0;      // when the track began
  double last_seen = 0;  // the last instant with points; older than now: coasting
};

enum class EventKind : std::uint8_t {
  kFall,
  kMotionless,
  kCrowding,
  kRunning,
  kCounterFlow,
  kLeftObject,
  kBoarding,
  kAlighting,
};

struct Event {
  EventKind kind = EventKind::kFall;
  std::uint32_t person = 0;  // 0: no single person
  double since = 0;
  FixedString<160> evidence;
};

// What INTERFACES' people file says of one FrameSet.
struct PeopleFrame {
  double time = 0;  // seconds since the recording's (or the daemon's) start
  FixedVector<Person, kPeopleMax> people;
  FixedVector<Event, kEventsMax> events;
  struct Skew {
    Name sensor;
    double skew_ms = 0;
  };
  FixedVector<Skew, kSensorsMax> skews;  // only sensors that are present at this instant
};

enum class Occupied : std::uint8_t { kFree, kOccupied, kUnobserved };

struct ZoneOccupancy {
  Name name;
  std::uint32_t count = 0;
  std::uint32_t capacity = 0;  // 0: none was stated
  double observed_share = 0;   // of the zone's air a person would fill, 0..1
};
struct SeatOccupancy {
  Name name;
  Occupied state = Occupied::kUnobserved;
  std::uint32_t person = 0;
};
struct DoorCount {
  Name name;
  std::uint32_t boarded = 0, alighted = 0;
};
struct Occupancy {
  std::uint32_t count = 0;
  double observed_share = 0;  // of the whole inside
  FixedVector<ZoneOccupancy, kZonesMax> zones;
  FixedVector<SeatOccupancy, kSeatsMax> seats;
  FixedVector<DoorCount, kDoorsMax> doors;
};

enum class SensorState : std::uint8_t { kStarting, kLearning, kOk, kDegraded, kLost };

// What a stereo camera says of itself.
struct StereoStatus {
  bool present = false;        // it is one
  double matched_share = 0;    // of its last image
  double unusable_s = 0;       // its images have been too dark or too bright to match for so long
  std::uint64_t unusable = 0;  // of its images so far
  double shutter_us = 0, gain_db = 0;  // asked for; 0: cannot be chosen
  double row_offset_px = 0;            // between its imagers' rows: 0 in a healthy pair
  bool misaligned = false;             // lastingly more than its matcher bears
};

struct SensorStatus {
  Name name;
  Name kind;
  SensorState state = SensorState::kStarting;
  double fps = 0, expected_fps = 0;
  std::uint64_t frames = 0, dropped = 0, damaged = 0, resets = 0;  // frames: good and used
  double skew_ms = 0, latency_ms = 0;
  double temperature_c = 0;
  bool has_temperature = false;
  double last_good = 0;         // time of the last good frame, same clock as Snapshot::time
  double background_share = 0;  // share of its pixels with a known background, 0..1
  double rms_px = 0;            // from calibration
  StereoStatus stereo;
  double dropped_share = 0;  // of the frames of the last ten seconds, damaged ones included
  FixedString<160> trouble;  // what its driver says: "what is wrong; what to do", or empty
};

struct StageTiming {
  Name name;
  double last_ms = 0, p50_ms = 0, p99_ms = 0;
};
inline constexpr std::size_t kStagesMax = 16;

enum class DoorState : std::uint8_t { kUnknown, kClosed, kOpen };
using DoorStates = FixedVector<DoorState, kDoorsMax>;  // of the wagon, in its order

// Signals of the train, when it has any.
struct VehicleState {
  bool is_listening = false;  // the settings name an input
  bool has_speed = false, has_stop = false;
  double speed = 0;  // m/s
  Name stop;         // where it stands; empty: between stops
  DoorStates doors;
  std::uint64_t lines = 0, bad_lines = 0, refused_connections = 0;
  FixedString<120> last_bad;  // the last line that was refused, and why
};
// Whether the train's signals are the same, whatever was counted.
inline bool says_the_same(const VehicleState& a, const VehicleState& b) {
  const bool same_doors = a.doors.size() == b.doors.size() &&
                          std::equal(a.doors.begin(), a.doors.end(), b.doors.begin());
  return a.has_speed == b.has_speed && a.has_stop == b.has_stop &&
         (!a.has_speed || a.speed == b.speed) && (!a.has_stop || a.stop == b.stop) && same_doors;
}

struct CalibrationStatus {
  bool present = false;
  Name source;              // file or "simulated" or "none: floor found in the recording"
  double created_unix = 0;  // 0: unknown
  bool has_georeference = false;
  double georeference_sigma_m = 0;
  bool drift_alarm = false;
  FixedString<160> drift_text;
};

enum class RecordingState : std::uint8_t { kOff, kOn, kNoDisk };

// The recording of what the sensors see, for the depot.
struct RecordingStatus {
  RecordingState state = RecordingState::kOff;
  double ends_in_s = 0;       // while it is on
  std::uint64_t frames = 0;   // of this recording, or the last one; on the disk
  std::uint64_t dropped = 0;  // that the disk was too slow or too full for
  std::uint64_t bytes = 0;
  std::uint32_t files = 0;
  FixedString<160> trouble;  // why there is no disk, or why it ended early: a sentence
};

enum class ThermalBand : std::uint8_t { kNormal, kWarm, kHot };

// How hot the unit's computer is, and what is left out so that it gets no hotter.
struct ThermalStatus {
  bool present = false;  // a zone could be read
  double hottest_c = 0;  // of all zones
  Name zone;             // which one that is
  ThermalBand band = ThermalBand::kNormal;
  double rate_limit_hz = 0;           // instants a second that are worked on at most; 0: all
  std::uint64_t spared_instants = 0;  // that were left out by it
};

// All that the web side and the bridge may know. One writer (control), many readers.
struct Snapshot {
  std::uint64_t sequence = 0;
  double time = 0;            // seconds since the daemon's start
  double unix_time = 0;       // wall clock of `time`; 0 when unsynchronised
  double monotonic_time = 0;  // the unit's monotonic clock at `time`: tells readers its age
  PeopleFrame frame;
  Occupancy occupancy;
  VehicleState vehicle;
  CalibrationStatus calibration;
  FixedVector<SensorStatus, kSensorsMax> sensors;
  FixedVector<StageTiming, kStagesMax> stages;
  std::uint64_t framesets = 0, framesets_dropped = 0;
  double frameset_rate = 0;
  double framesets_dropped_share = 0;  // of the last ten seconds
  double pipeline_latency_ms = 0;      // from the instant of a FrameSet to its answer
  double pipeline_cpu_share = 0;       // of one core
  std::uint64_t allocations_sealed = 0;
  std::uint64_t page_faults = 0;  // of the tracking thread since its first instant
  std::uint64_t resident_bytes = 0;
  std::uint32_t slots_in_use = 0, slots_high_water = 0, slots_capacity = 0;  // of the FramePool
  std::uint32_t web_restarts = 0;
  RecordingStatus recording;
  ThermalStatus thermal;
  bool learning = false;  // the background is not known yet
};
static_assert(std::is_trivially_copyable_v<Snapshot>, "a Snapshot lives in shared memory");

}  // namespace wagonsight
