#pragma once

#include <cstdint>

#include "base/time.h"

namespace wagonsight {

// What this process and this thread have used. None of these allocates; any thread.
std::uint64_t resident_bytes();       // now; 0 when /proc is not there
std::uint64_t resident_bytes_peak();  // since the start
Duration process_cpu_time();          // all threads, user and system
Duration thread_cpu_time();           // the calling thread

}  // namespace wagonsight
