#include "linux/workers.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <thread>
#include <vector>

#include "linux/resources.h"
#include "linux/sealed_heap.h"

namespace wagonsight {
namespace {

using namespace std::chrono_literals;

// As long as a part of an instant: long enough for the others to come.
void work_for(Duration duration) {
  const Duration end = thread_cpu_time() + duration;
  while (thread_cpu_time() < end) {
  }
}

class WorkersOf : public ::testing::TestWithParam<std::size_t> {};

TEST_P(WorkersOf, DoEachPartOnceAndOneAtATimeEach) {
  Workers workers(GetParam());
  ASSERT_EQ(workers.workers(), std::max<std::size_t>(GetParam(), 1));
  workers.start();
  std::vector<int> done;  // plain: who reads it must have waited for who wrote it
  std::array<std::array<int, 64>, 8> in_space{};  // a worker's own memory, unprotected
  for (std::size_t count = 0; count < 40; ++count) {
    done.assign(count, 0);
    run_parts(&workers, count, [&](std::size_t part, std::size_t worker) {
      ASSERT_LT(worker, workers.workers());
      in_space[worker].fill(static_cast<int>(part));
      ++done[part];
      for (const int value : in_space[worker]) ASSERT_EQ(value, static_cast<int>(part));
    });
    EXPECT_EQ(done, std::vector<int>(count, 1)) << count << " parts";
  }
}

INSTANTIATE_TEST_SUITE_P(Counts, WorkersOf, ::testing::Values(0, 1, 2, 3, 8));

TEST(Workers, DoEverythingByTheCallerBeforeTheyStartAndAfterTheyStopped) {
  Workers workers(3);
  const auto caller = std::this_thread::get_id();
  const auto all_by_caller = [&] {
    int parts = 0;
    run_parts(&workers, 5, [&](std::size_t, std::size_t worker) {
      EXPECT_EQ(worker, 0U);
      EXPECT_EQ(std::this_thread::get_id(), caller);
      ++parts;
    });
    return parts;
  };
  EXPECT_EQ(all_by_caller(), 5);
  workers.start();
  workers.stop();
  workers.stop();
  EXPECT_EQ(all_by_caller(), 5);
  workers.start();  // and again
}

TEST(Workers, ShareTheParts) {
  Workers workers(2);
  workers.start();
  std::array<int, 2> by_worker{};
  for (int job = 0; job < 5; ++job)
    run_parts(&workers, 8, [&](std::size_t, std::size_t worker) {
      ++by_worker[worker];
      std::this_thread::sleep_for(2ms);
    });
  EXPECT_EQ(by_worker[0] + by_worker[1], 40);
  EXPECT_GT(by_worker[0], 0);
  EXPECT_GT(by_worker[1], 0);
}

TEST(Workers, TellWhatTheyUsedAndThatTheyGoOn) {
  Workers workers(2);
  ASSERT_EQ(workers.helper_count(), 1U);
  workers.start();
  const std::uint64_t turns = workers.turns(0);
  const auto give_up = std::chrono::steady_clock::now() + 10s;
  while (workers.turns(0) < turns + 2 && std::chrono::steady_clock::now() < give_up)
    std::this_thread::sleep_for(5ms);
  EXPECT_GE(workers.turns(0), turns + 2) << "a thread without work must turn, too";
  for (int job = 0; job < 4; ++job)
    run_parts(&workers, 6, [](std::size_t, std::size_t) { work_for(3ms); });
  EXPECT_GT(workers.helpers_cpu_time(), Duration{});
}

TEST(Workers, AreSealed) {
  if (!allocations_are_seen()) GTEST_SKIP() << "allocations cannot be seen in this build";
  Workers workers(2);
  workers.start();
  const std::uint64_t before = sealed_allocations();
  std::array<bool, 2> took_part{};
  for (int job = 0; job < 50; ++job)
    run_parts(&workers, 4, [&](std::size_t, std::size_t worker) {
      took_part[worker] = true;
      std::this_thread::sleep_for(1ms);
    });
  EXPECT_TRUE(took_part[1]);
  EXPECT_EQ(sealed_allocations(), before) << "running a job allocated";
  run_parts(&workers, 40, [&](std::size_t, std::size_t worker) {
    if (worker == 1) delete new volatile int(1);
    std::this_thread::sleep_for(1ms);
  });
  EXPECT_GT(sealed_allocations(), before) << "an allocation in a worker was not seen";
}

TEST(Workers, SuitTheSensors) {
  EXPECT_EQ(suitable_workers(3, false), 3U);
  EXPECT_EQ(suitable_workers(1, true), 1U);
  EXPECT_EQ(suitable_workers(0, false), 1U);
  EXPECT_LE(suitable_workers(0, true), 2U);
  EXPECT_GE(suitable_workers(0, true), 1U);
}

}  // namespace
}  // namespace wagonsight
