#include "linux/threads.h"

#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace wagonsight {

void name_this_thread(std::string_view name) {
  std::array<char, 16> text{};  // the kernel's limit, with its terminating zero
  std::copy_n(name.begin(), std::min(name.size(), text.size() - 1), text.begin());
  pthread_setname_np(pthread_self(), text.data());
}

Result<void> pin_this_thread(int cpu) {
  if (cpu < 0 || cpu >= CPU_SETSIZE)
    return fail(fmt::format("processor {}: there is none of that number", cpu));
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(cpu), &set);
  const int error = pthread_setaffinity_np(pthread_self(), sizeof set, &set);
  if (error != 0)
    return fail(
        fmt::format("processor {}: this process may not run on it: {}", cpu, std::strerror(error)));
  return {};
}

Result<void> make_this_thread_realtime(int level) {
  sched_param parameters{};
  parameters.sched_priority = level;
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
  if (error != 0)
    return fail(
        fmt::format("real-time priority {}: {}; give the service CAP_SYS_NICE or "
                    "LimitRTPRIO",
                    level, std::strerror(error)));
  return {};
}

Result<void> make_this_thread_nice(int nice) {
  const auto thread = static_cast<id_t>(syscall(SYS_gettid));
  if (setpriority(PRIO_PROCESS, thread, nice) != 0)
    return fail(fmt::format("nice value {}: {}", nice, std::strerror(errno)));
  return {};
}

int usable_cpus() {
  cpu_set_t set;
  CPU_ZERO(&set);
  if (sched_getaffinity(0, sizeof set, &set) != 0) return 1;
  return std::max(1, CPU_COUNT(&set));
}

}  // namespace wagonsight
