#include "linux/sealed_heap.h"

#include <malloc.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <cstddef>
#include <cstdlib>
#include <string_view>
#include <utility>

#include "base/check.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define WAGONSIGHT_SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || \
    __has_feature(memory_sanitizer)
#define WAGONSIGHT_SANITIZED 1
#endif
#endif

namespace wagonsight {
namespace {

enum class ThreadHeap : std::uint8_t { kStartUp, kSealed, kExempt };

struct ThreadCount {
  std::uint64_t allocations = 0;
  ThreadHeap state = ThreadHeap::kStartUp;
};

// Read inside malloc, so access to it must not allocate: initial-exec needs no lazy set-up.
__attribute__((tls_model("initial-exec"))) thread_local constinit ThreadCount thread_count;

constinit std::atomic<std::uint64_t> sealed_count{0};
constinit std::atomic<std::uint64_t> exempt_count{0};
constinit std::atomic<SealedHeapRule> sealed_rule{SealedHeapRule::kCount};

// Without printf, which may allocate.
[[noreturn]] void abort_over(std::size_t bytes) {
  std::array<char, 24> digits{};
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), bytes).ptr;
  for (const std::string_view part :
       {std::string_view("broken contract: a sealed thread allocated "),
        std::string_view(digits.data(), static_cast<std::size_t>(end - digits.data())),
        std::string_view(" bytes\n")}) {
    if (::write(STDERR_FILENO, part.data(), part.size()) < 0) break;
  }
  std::abort();
}

inline void count_allocation(std::size_t bytes) {
  ++thread_count.allocations;
  if (thread_count.state == ThreadHeap::kStartUp) [[likely]]
    return;
  if (thread_count.state == ThreadHeap::kExempt) {
    exempt_count.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  sealed_count.fetch_add(1, std::memory_order_relaxed);
  if (sealed_rule.load(std::memory_order_relaxed) == SealedHeapRule::kAbort) abort_over(bytes);
}

}  // namespace
}  // namespace wagonsight

extern "C" {
#ifdef WAGONSIGHT_SANITIZED

// The sanitizers own malloc and call this.
__attribute__((weak)) int __sanitizer_install_malloc_and_free_hooks(
    void (*malloc_hook)(const volatile void*, std::size_t),
    void (*free_hook)(const volatile void*));

#else

// NOLINTBEGIN(bugprone-reserved-identifier,readability-identifier-naming,cppcoreguidelines-macro-usage)
#ifdef WAGONSIGHT_WRAPPED_HEAP
// Static programs: the linker was told --wrap=malloc and so on.
#define WAGONSIGHT_INTERPOSED(call) __wrap_##call
void* WAGONSIGHT_INTERPOSED(malloc)(std::size_t bytes);
void* WAGONSIGHT_INTERPOSED(calloc)(std::size_t count, std::size_t bytes);
void* WAGONSIGHT_INTERPOSED(realloc)(void* memory, std::size_t bytes);
void* WAGONSIGHT_INTERPOSED(memalign)(std::size_t alignment, std::size_t bytes);
void* WAGONSIGHT_INTERPOSED(aligned_alloc)(std::size_t alignment, std::size_t bytes);
int WAGONSIGHT_INTERPOSED(posix_memalign)(void** memory, std::size_t alignment, std::size_t bytes);
#else
#define WAGONSIGHT_INTERPOSED(call) call
#endif

// glibc's own names of what is interposed; free() stays glibc's.
void* __libc_malloc(std::size_t bytes);
void* __libc_calloc(std::size_t count, std::size_t bytes);
void* __libc_realloc(void* memory, std::size_t bytes);
void* __libc_memalign(std::size_t alignment, std::size_t bytes);
// NOLINTEND(bugprone-reserved-identifier,readability-identifier-naming,cppcoreguidelines-macro-usage)

void* WAGONSIGHT_INTERPOSED(malloc)(std::size_t bytes) {
  wagonsight::count_allocation(bytes);
  return __libc_malloc(bytes);
}
void* WAGONSIGHT_INTERPOSED(calloc)(std::size_t count, std::size_t bytes) {
  wagonsight::count_allocation(count * bytes);
  return __libc_calloc(count, bytes);
}
void* WAGONSIGHT_INTERPOSED(realloc)(void* memory, std::size_t bytes) {
  wagonsight::count_allocation(bytes);
  return __libc_realloc(memory, bytes);
}
void* WAGONSIGHT_INTERPOSED(memalign)(std::size_t alignment, std::size_t bytes) {
  wagonsight::count_allocation(bytes);
  return __libc_memalign(alignment, bytes);
}
void* WAGONSIGHT_INTERPOSED(aligned_alloc)(std::size_t alignment, std::size_t bytes) {
  wagonsight::count_allocation(bytes);
  return __libc_memalign(alignment, bytes);
}
int WAGONSIGHT_INTERPOSED(posix_memalign)(void** memory, std::size_t alignment, std::size_t bytes) {
  const bool power_of_two = alignment != 0 && (alignment & (alignment - 1)) == 0;
  if (!power_of_two || alignment % sizeof(void*) != 0) return EINVAL;
  wagonsight::count_allocation(bytes);
  void* allocated = __libc_memalign(alignment, bytes);
  if (allocated == nullptr) return ENOMEM;
  *memory = allocated;
  return 0;
}

#endif
}  // extern "C"

namespace wagonsight {
namespace {

bool start_seeing() {
#ifdef WAGONSIGHT_SANITIZED
  if (__sanitizer_install_malloc_and_free_hooks == nullptr) return false;
  return __sanitizer_install_malloc_and_free_hooks(
             [](const volatile void*, std::size_t bytes) { count_allocation(bytes); },
             [](const volatile void*) {}) != 0;
#else
  return true;
#endif
}

const bool kSeen = start_seeing();

}  // namespace

HeapSeal::HeapSeal() {
  WS_CHECK(thread_count.state == ThreadHeap::kStartUp, "this thread is sealed already");
  thread_count.state = ThreadHeap::kSealed;
}

HeapSeal::~HeapSeal() {
  thread_count.state = ThreadHeap::kStartUp;
}

HeapExemption::HeapExemption() : was_sealed_(thread_count.state == ThreadHeap::kSealed) {
  if (was_sealed_) thread_count.state = ThreadHeap::kExempt;
}

HeapExemption::~HeapExemption() {
  if (was_sealed_) thread_count.state = ThreadHeap::kSealed;
}

HeapExemptionPause::HeapExemptionPause() : was_exempt_(thread_count.state == ThreadHeap::kExempt) {
  if (was_exempt_) thread_count.state = ThreadHeap::kSealed;
}

HeapExemptionPause::~HeapExemptionPause() {
  if (was_exempt_) thread_count.state = ThreadHeap::kExempt;
}

void set_sealed_heap_rule(SealedHeapRule rule) {
  sealed_rule.store(rule);
}

std::uint64_t sealed_allocations() {
  return sealed_count.load(std::memory_order_relaxed);
}

std::uint64_t exempt_allocations() {
  return exempt_count.load(std::memory_order_relaxed);
}

std::uint64_t thread_allocations() {
  return thread_count.allocations;
}

bool allocations_are_seen() {
  return kSeen;
}

}  // namespace wagonsight
