#include <gtest/gtest.h>

#include <cstring>
#include <string_view>

#include "base/bounded_vector.h"
#include "base/crc32c.h"
#include "base/fixed_string.h"
#include "base/fixed_vector.h"
#include "base/result.h"
#include "base/spsc_ring.h"
#include "base/time.h"

namespace wagonsight {
namespace {

std::uint32_t crc_of(std::string_view text) {
  return crc32c(std::as_bytes(std::span(text.data(), text.size())));
}

TEST(Crc32c, MatchesThePublishedCheckValue) {
  EXPECT_EQ(crc_of("123456789"), 0xE3069283U);
}

TEST(Crc32c, ContinuesARunningSum) {
  const std::string_view text = "the first frame and the millionth";
  const std::uint32_t head = crc_of(text.substr(0, 13));
  EXPECT_EQ(crc32c(std::as_bytes(std::span(text.data() + 13, text.size() - 13)), head),
            crc_of(text));
}

TEST(FixedString, CutsLongText) {
  const FixedString<4> name("kinect");
  EXPECT_EQ(name.view(), "kine");
}

TEST(FixedVector, SaysWhenItIsFull) {
  FixedVector<int, 2> v;
  EXPECT_TRUE(v.try_push_back(1));
  EXPECT_TRUE(v.try_push_back(2));
  EXPECT_FALSE(v.try_push_back(3));
  EXPECT_DEATH(v[2], "index 2 of 2");
}

TEST(BoundedVector, KeepsItsHighWaterMark) {
  BoundedVector<int> v(3);
  v.resize(2);
  v.clear();
  EXPECT_EQ(v.high_water(), 2U);
  EXPECT_EQ(v.capacity(), 3U);
}

TEST(SpscRing, IsFirstInFirstOutAndBounded) {
  SpscRing<int> ring(4);
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(ring.try_push(i));
  EXPECT_FALSE(ring.try_push(4));
  for (int i = 0; i < 4; ++i) {
    int item = -1;
    ASSERT_TRUE(ring.try_pop(item));
    EXPECT_EQ(item, i);
  }
}

TEST(Result, CarriesItsSentence) {
  const Result<int> r = fail("rig.blob: too short");
  ASSERT_FALSE(r);
  EXPECT_EQ(r.error().message, "rig.blob: too short");
}

TEST(Time, RoundsToTheNearestNanosecond) {
  EXPECT_EQ(from_seconds(-1.5e-9).count(), -2);
  EXPECT_DOUBLE_EQ(to_milliseconds(from_seconds(0.25)), 250.0);
}

}  // namespace
}  // namespace wagonsight
