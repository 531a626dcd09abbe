#include "base/spsc_ring.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <thread>

namespace wagonsight {
namespace {

struct Message {
  std::uint64_t number = 0, negated = 0, squared = 0;
};

// One producer, one consumer: everything arrives once, whole and in order, at every capacity.
TEST(SpscRing, CarriesEverythingInOrderBetweenTwoThreads) {
  for (const std::size_t capacity : {1U, 2U, 8U, 64U}) {
    constexpr std::uint64_t kMessages = 20'000;
    SpscRing<Message> ring(capacity);
    std::thread producer([&] {
      for (std::uint64_t i = 0; i < kMessages; ++i)
        while (!ring.try_push({i, ~i, i * i})) std::this_thread::yield();
    });
    std::uint64_t wrong = 0;
    for (std::uint64_t i = 0; i < kMessages;) {
      Message message;
      if (!ring.try_pop(message)) {
        std::this_thread::yield();
        continue;
      }
      if (message.number != i || message.negated != ~i || message.squared != i * i) ++wrong;
      if (ring.size() > capacity) ++wrong;
      ++i;
    }
    producer.join();
    EXPECT_EQ(wrong, 0U) << capacity;
    EXPECT_EQ(ring.size(), 0U);
  }
}

TEST(SpscRingDeathTest, WantsAPowerOfTwo) {
  EXPECT_DEATH(SpscRing<int>(3), "capacity 3");
  EXPECT_DEATH(SpscRing<int>(0), "capacity 0");
}

}  // namespace
}  // namespace wagonsight
