#include "frame/frame.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <set>
#include <thread>
#include <vector>

#include "base/spsc_ring.h"

namespace wagonsight {
namespace {

TEST(ImageView, CountsRowByRow) {
  std::vector<int> pixels(12);
  const ImageView<int> image{pixels.data(), 4, 3};
  image.at(3, 2) = 7;
  EXPECT_EQ(pixels[11], 7);
  EXPECT_EQ(image.index(1, 2), 9U);
  EXPECT_EQ(image.span().size(), 12U);
}

TEST(FramePool, HandsOutEverySlotOnceAligned) {
  FramePool pool(5, 100);
  std::set<std::byte*> memories;
  for (int i = 0; i < 5; ++i) {
    FrameSlot* slot = pool.acquire();
    ASSERT_NE(slot, nullptr);
    EXPECT_EQ(slot->bytes.size(), 100U);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(slot->bytes.data()) % 64, 0U);
    std::memset(slot->bytes.data(), i, slot->bytes.size());
    memories.insert(slot->bytes.data());
  }
  EXPECT_EQ(memories.size(), 5U);
  EXPECT_EQ(pool.acquire(), nullptr);
  EXPECT_EQ(pool.in_use(), 5U);
  EXPECT_EQ(pool.high_water(), 5U);
}

TEST(FramePool, ResetsWhatASlotSays) {
  FramePool pool(1, 64);
  FrameSlot* slot = pool.acquire();
  slot->damaged = true;
  slot->sequence = 9;
  slot->width = 3;
  pool.release(slot);
  EXPECT_EQ(pool.in_use(), 0U);
  slot = pool.acquire();
  EXPECT_FALSE(slot->damaged);
  EXPECT_EQ(slot->sequence, 0U);
  EXPECT_EQ(slot->width, 0);
  EXPECT_EQ(slot->bytes.size(), 64U);
}

TEST(FramePool, IgnoresNoSlot) {
  FramePool pool(1, 64);
  pool.release(nullptr);
  EXPECT_EQ(pool.in_use(), 0U);
}

TEST(FramePoolDeathTest, RefusesASlotTwiceOrFromElsewhere) {
  FramePool pool(2, 64);
  FrameSlot* slot = pool.acquire();
  pool.release(slot);
  EXPECT_DEATH(pool.release(slot), "released twice");
  FrameSlot stranger;
  EXPECT_DEATH(pool.release(&stranger), "broken contract");
}

// Four threads take and give as fast as they can; nobody ever holds a slot that another has.
TEST(FramePool, IsSafeForManyThreads) {
  constexpr std::size_t kSlots = 6;
  FramePool pool(kSlots, 64);
  std::atomic<int> clashes{0}, taken{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      const auto mark = std::byte(t + 1);
      for (int i = 0; i < 20'000; ++i) {
        FrameSlot* slots[2] = {pool.acquire(), pool.acquire()};
        for (FrameSlot* slot : slots) {
          if (slot == nullptr) continue;
          taken.fetch_add(1, std::memory_order_relaxed);
          std::memset(slot->bytes.data(), static_cast<int>(mark), slot->bytes.size());
          slot->sequence = static_cast<std::uint32_t>(i);
        }
        for (FrameSlot* slot : slots) {
          if (slot == nullptr) continue;
          for (const std::byte b : slot->bytes)
            if (b != mark) clashes.fetch_add(1, std::memory_order_relaxed);
          pool.release(slot);
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(clashes.load(), 0);
  EXPECT_GT(taken.load(), 20'000);
  EXPECT_EQ(pool.in_use(), 0U);
  EXPECT_LE(pool.high_water(), kSlots);
}

// The way of every frame: a driver's thread fills a slot, the ring hands it on, the pipeline reads
// it and gives it back.
TEST(FramePool, FeedsAConsumerThroughARing) {
  constexpr std::uint32_t kFrames = 50'000;
  FramePool pool(4, 256);
  SpscRing<FrameSlot*> ring(4);
  std::thread driver([&] {
    for (std::uint32_t i = 0; i < kFrames;) {
      FrameSlot* slot = pool.acquire();
      if (slot == nullptr) {
        std::this_thread::yield();
        continue;
      }
      slot->sequence = i;
      std::memset(slot->bytes.data(), static_cast<int>(i % 251), slot->bytes.size());
      while (!ring.try_push(slot)) std::this_thread::yield();
      ++i;
    }
  });
  std::uint32_t expected = 0, torn = 0;
  while (expected < kFrames) {
    FrameSlot* slot = nullptr;
    if (!ring.try_pop(slot)) {
      std::this_thread::yield();
      continue;
    }
    ASSERT_EQ(slot->sequence, expected);
    for (const std::byte b : slot->bytes)
      if (b != std::byte(expected % 251)) ++torn;
    pool.release(slot);
    ++expected;
  }
  driver.join();
  EXPECT_EQ(torn, 0U);
  EXPECT_EQ(pool.in_use(), 0U);
}

TEST(FrameSlot, KnowsItsBytes) {
  FramePool pool(1, 640 * 480 * 2);
  FrameSlot* slot = pool.acquire();
  slot->width = 640;
  slot->height = 480;
  EXPECT_EQ(slot->image_bytes(), 640U * 480 * 2);
  slot->depth_pixels()[641] = 1234;
  EXPECT_EQ(slot->depth().at(1, 1), 1234);
  slot->format = PixelFormat::kRgb8;
  EXPECT_EQ(slot->image_bytes(), 640U * 480 * 3);
}

}  // namespace
}  // namespace wagonsight
