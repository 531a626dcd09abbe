#pragma once

#include <chrono>
#include <cstdint>

namespace wagonsight {

using Duration = std::chrono::nanoseconds;

// The unit's monotonic clock. It has no now(): time is data, it is injected by platform/linux, a
// recording or a simulation, so that replay gives the same bytes every time.
struct HostClock {
  using duration = Duration;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<HostClock, Duration>;
  static constexpr bool is_steady = true;
};
using HostTime = HostClock::time_point;

constexpr double to_seconds(Duration d) {
  return std::chrono::duration<double>(d).count();
}
constexpr double to_milliseconds(Duration d) {
  return to_seconds(d) * 1e3;
}

// Rounds to the nearest nanosecond. Valid for |s| < 9.2e9.
constexpr Duration from_seconds(double s) {
  return Duration{static_cast<std::int64_t>(s * 1e9 + (s < 0 ? -0.5 : 0.5))};
}

}  // namespace wagonsight
