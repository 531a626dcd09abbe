#pragma once

#include <string_view>

#include "base/result.h"

// What a thread says of itself to the system. Each acts on the calling thread.
namespace wagonsight {

// Shown by top and in core dumps; cut to 15 bytes.
void name_this_thread(std::string_view name);

// Runs only on this processor from now on. The Error says why not.
Result<void> pin_this_thread(int cpu);

// Real time (SCHED_FIFO) at the given level, 1 to 99, before all ordinary threads. Needs
// CAP_SYS_NICE or a limit that allows it; the Error says so and the thread goes on as it was.
Result<void> make_this_thread_realtime(int level);

// Ordinary scheduling, but politely: after threads of a lower nice value, 0 to 19.
Result<void> make_this_thread_nice(int nice);

// How many processors this process may use.
int usable_cpus();

}  // namespace wagonsight
