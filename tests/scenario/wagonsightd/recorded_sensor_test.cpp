// A recording as the daemon's source of frames: it ends, or it begins anew and times go on.
#include "recorded_sensor.h"

#include <gtest/gtest.h>

#include <fstream>

#include "linux/clocks.h"
#include "unit/recording/synthetic_recording.h"

namespace wagonsight {
namespace {

using namespace wagonsight::testing;  // NOLINT: the helpers of the recording's tests

constexpr std::uint32_t kFrames = 8;  // of a lap, of two sensors in turn
constexpr Duration kStep{2 * 33'333'333};
// Everything was due long ago, so that no test waits.
const HostTime kStart = host_now() - std::chrono::hours(1);

class RecordedSensorTest : public ::testing::Test {
 protected:
  void open(std::uint32_t frames) {
    const std::string path = ::testing::TempDir() + "/recorded_sensor_test_" +
                             ::testing::UnitTest::GetInstance()->current_test_info()->name() +
                             ".mcap";
    const auto bytes = record(frames);
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
    auto opened = RecordedSensor::open(path);
    ASSERT_TRUE(opened) << opened.error().message;
    sensor_ = std::move(*opened);
    sensor_->begin_at(kStart);
  }

  // The next frame, as it is handed on; nullptr when the recording has ended.
  FrameSlot* next() {
    FrameSlot* slot = nullptr;
    while (!ring_.try_pop(slot))
      if (!sensor_->poll(std::chrono::milliseconds(1), pool_, ring_)) return nullptr;
    return slot;
  }

  FramePool pool_{4, kWidth* kHeight * 4};
  SpscRing<FrameSlot*> ring_{4};
  std::unique_ptr<RecordedSensor> sensor_;
};

TEST_F(RecordedSensorTest, EndsWithItsLastFrame) {
  open(kFrames);
  for (std::uint32_t i = 0; i < kFrames; ++i) {
    FrameSlot* slot = next();
    ASSERT_NE(slot, nullptr) << "frame " << i;
    pool_.release(slot);
  }
  EXPECT_EQ(next(), nullptr);
  EXPECT_EQ(pool_.in_use(), 0U);
  EXPECT_EQ(sensor_->counters().frames, kFrames);
  EXPECT_EQ(sensor_->counters().damaged, 1U);  // the fourth came so, and is handed on so
}

TEST_F(RecordedSensorTest, LoopedGoesOnAsIfTheSensorsHadNeverStopped) {
  open(kFrames);
  sensor_->loop();
  OwnedSlot first;
  fill_frame(0, first);
  const Duration moved = kStart - sensor_->reader().start();
  for (std::uint32_t i = 0; i < 5 * kFrames; ++i) {
    SCOPED_TRACE("frame " + std::to_string(i));
    FrameSlot* slot = next();
    ASSERT_NE(slot, nullptr);
    // The times, numbers and ticks of frame i of a recording without an end, the image of its own.
    OwnedSlot wanted, shown;
    fill_frame(i % kFrames, shown);
    fill_frame(i % 2, wanted);
    const auto steps = static_cast<std::int64_t>(i / 2);
    EXPECT_EQ(slot->instant, wanted.slot.instant + moved + steps * kStep);
    EXPECT_EQ(slot->arrival, wanted.slot.arrival + moved + steps * kStep);
    EXPECT_EQ(slot->sensor_index, shown.slot.sensor_index);
    // A sensor's own lap is one number shorter than that of both, whose numbers it counts by.
    EXPECT_EQ(slot->sequence, shown.slot.sequence + i / kFrames * (kFrames - 1));
    EXPECT_EQ(slot->device_ticks, wanted.slot.device_ticks + static_cast<std::uint64_t>(2 * steps));
    const std::size_t used = shown.slot.image_bytes() * (i % 2 == 0 ? 1 : 2);
    EXPECT_TRUE(std::equal(shown.memory.begin(),
                           shown.memory.begin() + static_cast<std::ptrdiff_t>(used),
                           slot->bytes.begin()));
    pool_.release(slot);
  }
  EXPECT_EQ(sensor_->counters().frames, 5 * kFrames);
}

TEST_F(RecordedSensorTest, LoopedShowsASingleFrameEverySecond) {
  open(1);
  sensor_->loop();
  HostTime last{};
  for (int i = 0; i < 4; ++i) {
    FrameSlot* slot = next();
    ASSERT_NE(slot, nullptr);
    if (i > 0) {
      EXPECT_EQ(slot->instant - last, Duration(std::chrono::seconds(1)));
    }
    last = slot->instant;
    pool_.release(slot);
  }
}

TEST_F(RecordedSensorTest, LoopedWithoutAnyFrameEnds) {
  open(0);
  sensor_->loop();
  EXPECT_EQ(next(), nullptr);
}

}  // namespace
}  // namespace wagonsight
