#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "recording/recording_reader.h"
#include "recording/recording_writer.h"
#include "rig/rig.h"

// A small rig (a Kinect and a stereo camera) and frames with values that a mixed-up row, byte order
// or sensor would change.
namespace wagonsight::testing {

inline constexpr int kWidth = 32;
inline constexpr int kHeight = 24;

inline Rig small_rig() {
  Rig rig;
  RigSensor kinect;
  kinect.name = "k0";
  kinect.camera = {.width = kWidth, .height = kHeight, .fx = 30, .fy = 31, .cx = 15.5, .cy = 11.5};
  kinect.camera.distortion = {0.01, -0.02, 0.001, 0.002, 0.003};
  rig.sensors.push_back(kinect);
  RigSensor stereo;
  stereo.name = "s-0";
  stereo.kind = SensorKind::kStereo;
  stereo.camera = {.width = kWidth, .height = kHeight, .fx = 40, .fy = 40, .cx = 16, .cy = 12};
  stereo.stereo.baseline = 0.24;
  rig.sensors.push_back(stereo);
  return rig;
}

inline std::uint32_t mixed(std::uint32_t x) {  // a repeatable hash
  x ^= x >> 16U;
  x *= 0x7feb352dU;
  x ^= x >> 15U;
  x *= 0x846ca68bU;
  return x ^ (x >> 16U);
}

// A slot with its own memory.
struct OwnedSlot {
  std::vector<std::byte> memory = std::vector<std::byte>(kWidth * kHeight * 4);
  FrameSlot slot;
  OwnedSlot() { slot.bytes = memory; }
};

// Frame `i` of the alternating sensors; its times are told apart from each other.
inline void fill_frame(std::uint32_t i, OwnedSlot& owned) {
  FrameSlot& slot = owned.slot;
  slot.sensor_index = static_cast<std::uint8_t>(i % 2);
  slot.format = i % 2 == 0 ? PixelFormat::kDepth16 : PixelFormat::kGray8;
  slot.width = kWidth;
  slot.height = kHeight;
  slot.sequence = 1000 + i;
  slot.device_ticks = std::uint64_t{1} << 40U | i;
  slot.instant = HostTime{Duration{std::int64_t{i} * 33'333'333 - 5'000'000}};
  slot.arrival = slot.instant + Duration{21'000'007};
  slot.damaged = i % 7 == 3;
  const std::size_t used = slot.image_bytes() * (i % 2 == 0 ? 1 : 2);
  for (std::size_t at = 0; at < owned.memory.size(); ++at)
    owned.memory[at] =
        at < used ? static_cast<std::byte>(mixed(i * 7919 + static_cast<std::uint32_t>(at)))
                  : std::byte{0};
}

inline std::vector<std::byte> record(std::uint32_t frames, const McapWriterOptions& mcap = {}) {
  MemorySink sink;
  RecordingOptions options;
  options.mcap = mcap;
  options.provenance = {{"source", "test"}};
  auto writer = RecordingWriter::create(sink, small_rig(), options);
  EXPECT_TRUE(writer.has_value());
  OwnedSlot owned;
  for (std::uint32_t i = 0; i < frames; ++i) {
    fill_frame(i, owned);
    EXPECT_TRUE((*writer)->write(owned.slot).has_value());
  }
  EXPECT_TRUE((*writer)->finish().has_value());
  return {sink.bytes().begin(), sink.bytes().end()};
}

inline void expect_frame(std::uint32_t i, const OwnedSlot& read) {
  OwnedSlot wanted;
  fill_frame(i, wanted);
  EXPECT_EQ(read.slot.sensor_index, wanted.slot.sensor_index) << "frame " << i;
  EXPECT_EQ(read.slot.sequence, wanted.slot.sequence) << "frame " << i;
  EXPECT_EQ(read.slot.device_ticks, wanted.slot.device_ticks) << "frame " << i;
  EXPECT_EQ(read.slot.instant, wanted.slot.instant) << "frame " << i;
  EXPECT_EQ(read.slot.arrival, wanted.slot.arrival) << "frame " << i;
  EXPECT_EQ(read.slot.damaged, wanted.slot.damaged) << "frame " << i;
  EXPECT_EQ(read.slot.format, wanted.slot.format) << "frame " << i;
  const std::size_t used = wanted.slot.image_bytes() * (i % 2 == 0 ? 1 : 2);
  EXPECT_TRUE(std::equal(read.memory.begin(),
                         read.memory.begin() + static_cast<std::ptrdiff_t>(used),
                         wanted.memory.begin()))
      << "pixels of frame " << i;
}

}  // namespace wagonsight::testing
