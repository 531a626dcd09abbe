#include "counted_heap.h"

#include <cstdlib>
#include <new>

// A sanitizer has a heap of its own that must not be mixed with this one.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define COUNTED_HEAP 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define COUNTED_HEAP 0
#endif
#endif
#ifndef COUNTED_HEAP
#define COUNTED_HEAP 1
#endif

namespace wagonsight {
namespace {

std::size_t allocations = 0;

}  // namespace

std::size_t allocation_count() {
  return allocations;
}
bool allocations_are_counted() {
  return COUNTED_HEAP != 0;
}
void count_allocation() {
  ++allocations;
}

}  // namespace wagonsight

#if COUNTED_HEAP
// In a file of their own, so that no caller is compiled with them in view.
void* operator new(std::size_t size) {
  wagonsight::count_allocation();
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}
#endif
