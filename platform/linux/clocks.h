#pragma once

#include "base/time.h"

namespace wagonsight {

// The unit's monotonic clock now: CLOCK_MONOTONIC. Any thread; does not allocate.
HostTime host_now();

// The same as a bare duration, for Pipeline::set_ticker.
Duration host_ticks();

// What the unit believes the time of day to be.
struct WallTime {
  double unix_s = 0;
  bool synchronised = false;  // by NTP, as the kernel was told; without it the date may be anything
};
WallTime wall_now();

}  // namespace wagonsight
