#pragma once

#include "daemon.h"
#include "linux/stop_signals.h"
#include "snapshot/unit_info.h"
#include "vigil.h"

namespace wagonsight {

// After too many crashes: serves the page, which says so, and neither opens a sensor nor computes.
// Needs no calibration and not even sound settings: without them it listens on loopback. Ends by
// itself after kSafeModeMax, so that whoever supervises tries the whole unit again.
Result<void> run_safe_mode(const DaemonOptions& options, const StopSignals& signals, Vigil& vigil);

inline constexpr Duration kSafeModeMax = std::chrono::minutes(5);

LastCrash last_crash(const PreviousCrash& previous);

}  // namespace wagonsight
