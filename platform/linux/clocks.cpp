#include "linux/clocks.h"

#include <sys/timex.h>
#include <time.h>  // NOLINT(modernize-deprecated-headers): POSIX clocks

#include "base/check.h"

namespace wagonsight {
namespace {

Duration read_clock(clockid_t clock) {
  timespec now{};
  WS_CHECK(clock_gettime(clock, &now) == 0, "clock %d", clock);
  return std::chrono::seconds(now.tv_sec) + Duration(now.tv_nsec);
}

}  // namespace

Duration host_ticks() {
  return read_clock(CLOCK_MONOTONIC);
}

HostTime host_now() {
  return HostTime(host_ticks());
}

WallTime wall_now() {
  timex state{};  // modes = 0: only asks
  const int answer = adjtimex(&state);
  const bool synchronised = answer >= 0 && answer != TIME_ERROR && (state.status & STA_UNSYNC) == 0;
  return {to_seconds(read_clock(CLOCK_REALTIME)), synchronised};
}

}  // namespace wagonsight
