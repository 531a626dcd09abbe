#include "linux/stop_signals.h"

#include <pthread.h>
#include <signal.h>  // NOLINT(modernize-deprecated-headers): POSIX signals
#include <time.h>    // NOLINT(modernize-deprecated-headers): timespec

#include <algorithm>

#include "base/check.h"

namespace wagonsight {
namespace {

sigset_t stop_set() {
  sigset_t set;
  sigemptyset(&set);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&set, signal);
  return set;
}

}  // namespace

StopSignals::StopSignals() {
  const sigset_t set = stop_set();
  WS_CHECK(pthread_sigmask(SIG_BLOCK, &set, nullptr) == 0, "signals could not be blocked");
  signal(SIGPIPE, SIG_IGN);
}

std::optional<int> StopSignals::wait(Duration timeout) const {
  const sigset_t set = stop_set();
  const auto ns = std::max(timeout, Duration{}).count();
  constexpr std::int64_t kBillion = 1'000'000'000;
  const timespec wait{static_cast<time_t>(ns / kBillion), static_cast<long>(ns % kBillion)};
  const int signal = sigtimedwait(&set, nullptr, &wait);
  return signal > 0 ? std::optional(signal) : std::nullopt;
}

void StopSignals::restore() {
  const sigset_t set = stop_set();
  pthread_sigmask(SIG_UNBLOCK, &set, nullptr);
  signal(SIGPIPE, SIG_DFL);
}

}  // namespace wagonsight
