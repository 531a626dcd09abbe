#include "capture/recovery.h"

#include <gtest/gtest.h>

namespace wagonsight {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

HostTime at(double s) {
  return HostTime(from_seconds(s));
}

TEST(Recovery, LooksForADeviceThatIsNotThereWithoutWaitingLonger) {
  Recovery recovery;
  for (int i = 0; i < 20; ++i) {
    recovery.not_there(at(i));
    EXPECT_EQ(recovery.next_attempt(), at(i) + milliseconds(500));
    EXPECT_EQ(recovery.failures(), 0);
  }
}

TEST(Recovery, WaitsLongerAfterEachFailureUpToHalfAMinute) {
  Recovery recovery;
  Duration last{};
  for (int i = 0; i < 12; ++i) {
    recovery.failed(at(100.0 * i));
    const Duration pause = recovery.next_attempt() - at(100.0 * i);
    EXPECT_GE(pause, last);
    EXPECT_LE(pause, seconds(30));
    last = pause;
  }
  EXPECT_EQ(last, seconds(30));
  EXPECT_EQ(recovery.failures(), 12);
}

TEST(Recovery, FramesForFiveSecondsForgiveWhatWas) {
  Recovery recovery;
  recovery.failed(at(0));
  recovery.opened(at(1));
  EXPECT_TRUE(recovery.frame(at(1.5)));
  EXPECT_FALSE(recovery.frame(at(1.9)));
  EXPECT_FALSE(recovery.is_silent(at(2)));
  EXPECT_EQ(recovery.failures(), 1);
  recovery.frame(at(6.2));
  EXPECT_FALSE(recovery.is_silent(at(6.3)));
  EXPECT_EQ(recovery.failures(), 0);
  // Silence after that is the first failure to come, and is answered at once.
  EXPECT_TRUE(recovery.is_silent(at(6.8)));
  EXPECT_TRUE(recovery.is_closed());
  EXPECT_EQ(recovery.failures(), 0);
  EXPECT_EQ(recovery.next_attempt(), at(6.8));
}

TEST(Recovery, GivesTheFirstFrameLongerThanTheOthers) {
  Recovery recovery;
  recovery.opened(at(0));
  EXPECT_FALSE(recovery.is_silent(at(1.9)));
  EXPECT_TRUE(recovery.is_silent(at(2.1)));
  EXPECT_EQ(recovery.failures(), 1);
}

}  // namespace
}  // namespace wagonsight
