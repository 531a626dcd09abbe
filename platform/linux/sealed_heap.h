#pragma once

#include <cstdint>

// Start-up allocates everything; after that the data threads do without the heap, and this watches
// that they do.
//
//     start-up  --- HeapSeal made --->  sealed  <--->  exempt (HeapExemption)
//         ^------- HeapSeal gone -----------'
//
// Each thread has its own state. In a sealed thread every malloc, calloc, realloc or operator new,
// whoever calls it, is counted, or aborts when tests ask for that. An exemption is for calls that
// are known to allocate (libusb does on every isochronous submit); they are counted apart.
// Giving memory back is always allowed.
//
// Works by interposing malloc in programs that use this (a static one is linked with --wrap, see
// CMakeLists.txt), and by the sanitizers' hooks under those
// (the thread sanitizer's does not tell of aligned allocations).
namespace wagonsight {

// Seals the calling thread while it lives.
class HeapSeal {
 public:
  HeapSeal();
  ~HeapSeal();
  HeapSeal(const HeapSeal&) = delete;
  HeapSeal& operator=(const HeapSeal&) = delete;
};

// Lets a sealed thread allocate while it lives.
class HeapExemption {
 public:
  HeapExemption();
  ~HeapExemption();
  HeapExemption(const HeapExemption&) = delete;
  HeapExemption& operator=(const HeapExemption&) = delete;

 private:
  bool was_sealed_;
};

// Our own code that a library calls within an exemption: seals again what the exemption let go.
class HeapExemptionPause {
 public:
  HeapExemptionPause();
  ~HeapExemptionPause();
  HeapExemptionPause(const HeapExemptionPause&) = delete;
  HeapExemptionPause& operator=(const HeapExemptionPause&) = delete;

 private:
  bool was_exempt_;
};

enum class SealedHeapRule { kCount, kAbort };
// For the whole process; kCount until told otherwise.
void set_sealed_heap_rule(SealedHeapRule rule);

// Since the start, over all threads.
std::uint64_t sealed_allocations();
std::uint64_t exempt_allocations();

// All allocations of the calling thread since it started, sealed or not: for tests that hold two
// readings against each other.
std::uint64_t thread_allocations();

// False where allocations cannot be seen (an unknown sanitizer): counts stay zero then.
bool allocations_are_seen();

}  // namespace wagonsight
