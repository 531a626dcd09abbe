#pragma once

#include <optional>

#include "base/time.h"

namespace wagonsight {

// SIGINT, SIGTERM and SIGHUP as values that a thread asks for, instead of handlers that interrupt.
// Made first thing in main(): threads that are started later inherit that these are blocked.
// SIGPIPE is ignored from then on: a peer that hung up is an error of write().
class StopSignals {
 public:
  StopSignals();

  // The signal that came, waiting at most so long. One thread.
  std::optional<int> wait(Duration timeout) const;

  // For a child process: gives it the usual signals back.
  static void restore();
};

}  // namespace wagonsight
