#pragma once

#include <cstdint>
#include <string_view>

#include "base/result.h"
#include "daemon.h"

namespace wagonsight {

// What wagonsightd is asked to do.
struct Command {
  enum class Kind : std::uint8_t { kRun, kCheck, kHelp, kVersion };
  Kind kind = Kind::kRun;
  DaemonOptions options;
  bool with_files = false;  // kCheck: also the files that the settings name
};

extern const std::string_view kHelpText;

// Reads the arguments; RUNTIME_DIRECTORY stands in for --state. The Error names the argument that
// is wrong. Not thread-safe (getopt's state), to be called once at the start.
Result<Command> read_command(int argc, char** argv);

}  // namespace wagonsight
