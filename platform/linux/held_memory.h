#pragma once

#include <cstdint>

#include "base/result.h"

// Memory that is there before it is needed. The kernel gives a page when it is first touched, which
// costs microseconds in the middle of some frame, and takes it only if there is one to give.
namespace wagonsight {

struct HeldMemory {
  std::uint64_t held_bytes = 0;    // private memory that is resident now and written to
  std::uint64_t locked_bytes = 0;  // of it what the kernel will never page out
};

// Makes all private writable memory that the process has now resident: heap, statics, the calling
// thread's stack. To be called when everything is allocated and before there are other threads
// (their stacks would become resident to the last page). Memory that was given back is let go
// first. Locking is tried and needs CAP_IPC_LOCK or LimitMEMLOCK; without it the memory is held
// all the same as long as nothing is paged out. The program's own code becomes
// resident, too. The Error names what the kernel refused.
Result<HeldMemory> hold_memory();

// The same for the calling thread's stack: more of it than any of our threads uses.
void hold_this_stack();

// Page faults of the calling thread since it started for which no disk was needed.
std::uint64_t thread_page_faults();

}  // namespace wagonsight
