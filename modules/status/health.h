#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "snapshot/snapshot.h"
#include "snapshot/unit_info.h"

// Is the unit well, and if not, what is wrong, why, and what is a person to do about it?
namespace wagonsight {

enum class Verdict : std::uint8_t { kOk, kDegraded, kFailed };
std::string_view to_text(Verdict verdict);  // "ok", "degraded", "failed"

struct Fault {
  std::string id;                       // stable, for programs: "sensor_lost"
  std::string subject;                  // what it is about: a sensor's name, or empty
  Verdict weight = Verdict::kDegraded;  // kOk: worth knowing, changes no verdict
  std::string cause;                    // one sentence
  std::string next_action;              // one sentence, an imperative
};

// One line of /readyz?verbose.
struct Check {
  std::string name;
  bool passed = false;
  std::string detail;
};

struct Health {
  Verdict verdict = Verdict::kOk;
  std::string sentence;       // the verdict in plain words
  std::vector<Fault> faults;  // heaviest first
  bool ready = false;         // the whole pipeline runs on plausible frames
  std::vector<Check> checks;
};

// From when on a figure is a fault. Seconds and shares, never frames.
struct HealthLimits {
  double snapshot_age_s_max = 3.0;  // the control thread publishes many times a second
  double frame_age_s_max = 1.0;
  double start_s_max = 5.0;         // until the first frame is worked on
  double rate_share_min = 0.8;      // of the expected rate
  double dropped_share_max = 0.01;  // what the product promises
  double skew_ms_max = 20.0;  // an unsynchronised Kinect is at most half a frame away: 16.7 ms
  double temperature_c_max = 70.0;
  double calibration_rms_px_max = 1.0;
  double unusable_s_max = 3.0;  // a tunnel's end is mastered within a second
};

// What the health of a moment is judged by.
struct StatusInput {
  const Snapshot* snapshot = nullptr;  // nullptr: nothing was published yet
  double snapshot_age_s = 0;           // by the unit's monotonic clock
  const UnitInfo* unit = nullptr;      // never nullptr
  const LogTail* log = nullptr;        // nullptr: none
};

Health assess(const StatusInput& input, const HealthLimits& limits = {});

}  // namespace wagonsight
