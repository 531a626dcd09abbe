#include "base/seqlock.h"

#include <gtest/gtest.h>

#include <array>
#include <thread>

namespace wagonsight {
namespace {

struct Odd {  // a size that is no multiple of a word
  std::array<std::uint32_t, 33> numbers{};
};

TEST(Seqlock, IsEmptyUntilTheFirstStore) {
  Seqlock<Odd> shared;
  Odd value;
  EXPECT_FALSE(shared.load(value));
  value.numbers[32] = 7;
  shared.store(value);
  Odd read;
  ASSERT_TRUE(shared.load(read));
  EXPECT_EQ(read.numbers[32], 7U);
  EXPECT_EQ(shared.version(), 1U);
}

TEST(Seqlock, NeverShowsHalfAValue) {
  Seqlock<Odd> shared;
  std::atomic<bool> done{false};
  std::thread writer([&] {
    for (std::uint32_t i = 1; i <= 20'000; ++i) {
      Odd value;
      value.numbers.fill(i);
      shared.store(value);
    }
    done = true;
  });
  std::uint32_t last = 0;
  int whole = 0;
  while (!done || whole == 0) {
    Odd value;
    if (!shared.load(value)) continue;
    ++whole;
    for (const std::uint32_t number : value.numbers) ASSERT_EQ(number, value.numbers[0]);
    ASSERT_GE(value.numbers[0], last);
    last = value.numbers[0];
  }
  writer.join();
  Odd value;
  ASSERT_TRUE(shared.load(value));
  EXPECT_EQ(value.numbers[0], 20'000U);
}

}  // namespace
}  // namespace wagonsight
