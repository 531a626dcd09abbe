#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "base/result.h"

namespace wagonsight {

struct DaemonOptions {
  std::string config;                 // the settings file
  std::string rig;                    // a calibration blob instead of the settings'; empty: none
  std::optional<std::uint16_t> port;  // instead of the settings'
  // Where a record of each run is kept, for the next one; cleared when the machine starts. Empty:
  // none.
  std::string state_folder;
  std::string updater;  // the path of its socket; empty: none
};

// Runs the unit until SIGTERM, SIGINT or SIGHUP. The Error says what kept it from starting.
Result<void> run_daemon(const DaemonOptions& options);

}  // namespace wagonsight
