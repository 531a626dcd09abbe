#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "base/fixed_vector.h"
#include "drift_watch.h"
#include "frame_source.h"
#include "shared_block.h"
#include "tracking.h"
#include "unit.h"

namespace wagonsight {

// The daemon's messages: to stderr, where the system's log takes them up, and to the tail that the
// page shows. Control thread only.
class UnitLog {
 public:
  UnitLog(SharedBlock& block, HostTime daemon_start);
  void say(Severity severity, std::string_view text);

 private:
  SharedBlock& block_;
  HostTime daemon_start_;
  std::unique_ptr<LogTail> tail_;
};

// Makes the Snapshot out of what the threads count, and publishes it. Control thread only.
class Publisher {
 public:
  Publisher(const Unit& unit, SharedBlock& block, UnitLog& log, HostTime daemon_start);

  void publish(const Tracking& tracking, const DriftWatch& drift,
               const std::vector<std::unique_ptr<SourceThread>>& sources, const FramePool& pool,
               std::uint32_t web_restarts, const RecordingStatus& recording,
               const VehicleState& vehicle, const ThermalStatus& thermal);

 private:
  // Counters as they were some seconds ago, for rates and shares of the last ten seconds.
  struct Sample {
    double time = 0;
    std::uint64_t framesets = 0, framesets_dropped = 0;
    double cpu_s = 0;
    std::array<std::uint64_t, kSensorsMax> frames{}, lost{};
  };
  static constexpr std::size_t kSamples = 11;  // one a second

  void tell_sensors(const std::vector<std::unique_ptr<SourceThread>>& sources);
  void tell_sensor(std::size_t index);
  void tell_rates();
  void settle();
  void tell_stages();
  void tell_drift(const DriftWatch& drift);
  void tell_unit(const FramePool& pool);
  void log_changes();
  void log_recording();

  SharedBlock& block_;
  UnitLog& log_;
  HostTime daemon_start_;
  std::unique_ptr<Snapshot> snapshot_;
  std::unique_ptr<TrackingReport> report_;
  FixedVector<Sample, kSamples> samples_;  // oldest first
  std::array<SensorState, kSensorsMax> told_states_{};
  std::array<double, kSensorsMax> changed_at_{};
  bool told_learning_ = true;
  bool settled_ = false;    // the start is over
  double learned_at_ = -1;  // when the background became known; below zero: not yet
  DriftReport drift_;
  std::uint32_t told_notes_ = 0;
  double stages_told_at_ = -1e9;
  RecordingState told_recording_ = RecordingState::kOff;
};

}  // namespace wagonsight
