#include "linux/held_memory.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>

#include "linux/resources.h"

namespace wagonsight {
namespace {

constexpr std::size_t kBytes = std::size_t{16} << 20U;
constexpr std::size_t kPage = 4096;

struct Freed {
  void operator()(unsigned char* memory) const { std::free(memory); }
};

// How many page faults writing to every page costs.
std::uint64_t faults_of_touching(unsigned char* memory) {
  const std::uint64_t before = thread_page_faults();
  for (std::size_t at = 0; at < kBytes; at += kPage)
    static_cast<volatile unsigned char*>(memory)[at] = 1;
  return thread_page_faults() - before;
}

TEST(HeldMemory, IsThereBeforeItIsTouched) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer's shadow would be made resident, too";
#endif
  // Fresh memory of this size is mapped; transparent huge pages would make a few faults of it.
  const std::unique_ptr<unsigned char, Freed> cold(
      static_cast<unsigned char*>(std::calloc(1, kBytes)));
  EXPECT_GT(faults_of_touching(cold.get()), 5U);

  const std::unique_ptr<unsigned char, Freed> held(
      static_cast<unsigned char*>(std::calloc(1, kBytes)));
  const auto result = hold_memory();
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_GE(result->held_bytes, 2 * kBytes);
  EXPECT_LE(result->locked_bytes, result->held_bytes);
  EXPECT_GE(resident_bytes(), 2 * kBytes);
  EXPECT_EQ(faults_of_touching(held.get()), 0U);
}

}  // namespace
}  // namespace wagonsight
