#include "base/fresh_array.h"

#include <gtest/gtest.h>

#include <unistd.h>
#include <cstdint>
#include <fstream>
#include <string>

namespace wagonsight {
namespace {

struct Zero {
  float x = 0;
  std::uint8_t flag = 0;  // padding follows
};
struct NotZero {
  int index = -1;
  double share = 0.5;
};

TEST(FreshArray, HoldsDefaultValues) {
  const auto zeros = make_fresh_array<Zero>(1000);
  const auto others = make_fresh_array<NotZero>(1000);
  for (std::size_t i = 0; i < 1000; ++i) {
    ASSERT_EQ(zeros[i].x, 0);
    ASSERT_EQ(zeros[i].flag, 0);
    ASSERT_EQ(others[i].index, -1);
    ASSERT_EQ(others[i].share, 0.5);
  }
  EXPECT_EQ(make_fresh_array<Zero>(0), nullptr);
}

std::size_t resident_pages() {
  std::ifstream in("/proc/self/statm");
  std::size_t size = 0, resident = 0;
  in >> size >> resident;
  return resident;
}

TEST(FreshArray, IsNotResidentBeforeItIsTouched) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "the sanitizers' heaps touch what they give out";
#endif
  constexpr std::size_t kBytes = std::size_t{64} << 20;
  const std::size_t before = resident_pages();
  const auto array = make_fresh_array<Zero>(kBytes / sizeof(Zero));
  const std::size_t page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  EXPECT_LT(resident_pages() - before, kBytes / page / 16);
  for (std::size_t i = 0; i < kBytes / sizeof(Zero); ++i) array[i].x = 1;
  EXPECT_GT(resident_pages() - before, kBytes / page / 2);
}

}  // namespace
}  // namespace wagonsight
