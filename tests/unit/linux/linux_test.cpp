#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>
#include <signal.h>

#include <array>
#include <cstdlib>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "linux/clocks.h"
#include "linux/resources.h"
#include "linux/sealed_heap.h"
#include "linux/stop_signals.h"
#include "linux/threads.h"

namespace wagonsight {
namespace {

TEST(Clocks, RunForward) {
  const HostTime before = host_now();
  const Duration ticks = host_ticks();
  EXPECT_LE(before.time_since_epoch(), ticks);
  EXPECT_LE(ticks, host_now().time_since_epoch());
  EXPECT_GT(wall_now().unix_s, 1.6e9);
}

TEST(Resources, AreMeasured) {
  const Duration thread_before = thread_cpu_time(), process_before = process_cpu_time();
  volatile double sink = 0;
  for (int i = 0; i < 1'000'000; ++i) sink = sink + i;
  EXPECT_GT(thread_cpu_time(), thread_before);
  EXPECT_GE(process_cpu_time() - process_before, Duration{});

  const std::uint64_t before = resident_bytes();
  EXPECT_GT(before, 100'000U);
  constexpr std::size_t kMore = 64 << 20;
  std::vector<char> more(kMore, 'x');
  EXPECT_GE(resident_bytes(), before + kMore / 2);
  EXPECT_GE(resident_bytes_peak() + (1 << 20), resident_bytes());
  EXPECT_EQ(more[kMore / 2], 'x');
}

TEST(Threads, CarryTheirName) {
  std::thread([] {
    name_this_thread("a-name-that-is-too-long");
    std::array<char, 16> name{};
    pthread_getname_np(pthread_self(), name.data(), name.size());
    EXPECT_STREQ(name.data(), "a-name-that-is-");
  }).join();
}

TEST(Threads, SayWhyTheyCannotBePinned) {
  std::thread([] {
    const auto pinned = pin_this_thread(100'000);
    ASSERT_FALSE(pinned);
    EXPECT_EQ(pinned.error().message, "processor 100000: there is none of that number");
  }).join();
}

TEST(Threads, CanBePinnedAndMadeNice) {
  std::thread([] {
    EXPECT_GE(usable_cpus(), 1);
    const auto nice = make_this_thread_nice(5);
    EXPECT_TRUE(nice) << nice.error().message;
    cpu_set_t set;
    ASSERT_EQ(sched_getaffinity(0, sizeof set, &set), 0);
    for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) {
      if (!CPU_ISSET(static_cast<std::size_t>(cpu), &set)) continue;
      const auto pinned = pin_this_thread(cpu);
      EXPECT_TRUE(pinned) << pinned.error().message;
      EXPECT_EQ(usable_cpus(), 1);
      return;
    }
  }).join();
}

TEST(StopSignals, ArriveAsValues) {
  const StopSignals signals;
  EXPECT_FALSE(signals.wait(Duration{}));
  pthread_kill(pthread_self(), SIGTERM);
  EXPECT_EQ(signals.wait(std::chrono::seconds(10)), SIGTERM);
  EXPECT_FALSE(signals.wait(std::chrono::milliseconds(1)));
  StopSignals::restore();
}

// Kept where the compiler cannot see that nobody reads it.
void* volatile escape = nullptr;

void allocate_some(std::size_t bytes) {
  const auto memory = std::make_unique<std::byte[]>(bytes);
  escape = memory.get();
}

TEST(SealedHeap, SeesEveryKindOfAllocation) {
  if (!allocations_are_seen()) GTEST_SKIP() << "this sanitizer hides allocations";
  const std::uint64_t before = thread_allocations();
  allocate_some(10);
  EXPECT_EQ(thread_allocations(), before + 1);
  void* memory = std::malloc(20);
  escape = memory;
  EXPECT_EQ(thread_allocations(), before + 2);
  memory = std::realloc(memory, 4000);
  escape = memory;
  EXPECT_GE(thread_allocations(), before + 3);
  std::free(memory);
  const std::uint64_t later = thread_allocations();
  escape = memory = std::calloc(3, 7);
  std::free(memory);
  EXPECT_EQ(thread_allocations(), later + 1);
#ifndef __SANITIZE_THREAD__  // its hook is silent here
  ASSERT_EQ(posix_memalign(&memory, 64, 100), 0);
  escape = memory;
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(memory) % 64, 0U);
  std::free(memory);
  escape = memory = std::aligned_alloc(128, 256);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(memory) % 128, 0U);
  std::free(memory);
  EXPECT_EQ(thread_allocations(), later + 3);
#endif
}

TEST(SealedHeap, CountsOnlyWhatASealedThreadAllocates) {
  if (!allocations_are_seen()) GTEST_SKIP() << "this sanitizer hides allocations";
  const std::uint64_t sealed_before = sealed_allocations(), exempt_before = exempt_allocations();
  std::thread([] {
    allocate_some(10);  // start-up
    const HeapSeal seal;
    allocate_some(10);
    allocate_some(10);
    {
      const HeapExemption exemption;
      allocate_some(10);
      {
        const HeapExemptionPause pause;
        allocate_some(10);  // our own code that a library called
      }
    }
    const HeapExemptionPause without_effect;
    std::thread other;  // not started: no allocation
    allocate_some(10);
  }).join();
  std::thread([] { allocate_some(10); }).join();
  EXPECT_EQ(sealed_allocations() - sealed_before, 4U);
  EXPECT_EQ(exempt_allocations() - exempt_before, 1U);
}

TEST(SealedHeap, LetsMemoryGoBack) {
  auto memory = std::make_unique<int>(1);
  const std::uint64_t before = sealed_allocations();
  const HeapSeal seal;
  memory.reset();
  EXPECT_EQ(sealed_allocations(), before);
}

TEST(SealedHeapDeathTest, AbortsWhenTestsAskForIt) {
  if (!allocations_are_seen()) GTEST_SKIP() << "this sanitizer hides allocations";
  EXPECT_DEATH(
      {
        set_sealed_heap_rule(SealedHeapRule::kAbort);
        const HeapSeal seal;
        allocate_some(4711);
      },
      "a sealed thread allocated 4711 bytes");
}

}  // namespace
}  // namespace wagonsight
