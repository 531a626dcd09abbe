#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "base/capacities.h"
#include "base/time.h"
#include "frame/image.h"

namespace wagonsight {

// How an image was taken, where that can be chosen; zeros: it cannot, or is not known.
struct Exposure {
  float shutter_us = 0;
  float gain_db = 0;
};

// One image of one sensor and what is known of its time. Memory belongs to the FramePool.
// A depth sensor fills `bytes` with 16-bit millimetres; a stereo camera with its left image
// followed by its right one (same format), which the stereo module turns into depth.
struct FrameSlot {
  std::uint8_t sensor_index = 0;   // into Rig::sensors
  std::uint32_t sequence = 0;      // the device's own frame counter, or counted by the driver
  std::uint64_t device_ticks = 0;  // the device's clock, unwrapped
  HostTime arrival{};              // when the host had the whole frame
  HostTime instant{};              // when the light was taken, by the clock fit
  Exposure exposure{};             // of a camera whose driver obeys set_exposure()
  bool damaged = false;            // packets were lost; never passed on silently
  PixelFormat format = PixelFormat::kDepth16;
  int width = 0;
  int height = 0;              // of one image
  std::span<std::byte> bytes;  // capacity of the slot; image_bytes() of it are used

  std::size_t image_bytes() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
           bytes_per_pixel(format);
  }
  // Valid for kDepth16.
  DepthImage depth() const {
    return {reinterpret_cast<const std::uint16_t*>(bytes.data()), width, height};
  }
  std::span<std::uint16_t> depth_pixels() const {
    return {reinterpret_cast<std::uint16_t*>(bytes.data()),
            static_cast<std::size_t>(width) * static_cast<std::size_t>(height)};
  }
};

// A fixed number of equal slots. acquire() and release() are lock-free and may be called by any
// thread: drivers acquire, the pipeline releases. Nothing allocates after construction.
class FramePool {
 public:
  // Every slot can hold `slot_bytes` bytes, aligned to 64.
  FramePool(std::size_t slot_count, std::size_t slot_bytes);

  // A free slot, its fields reset, or nullptr when all are in use (the caller drops its frame and
  // counts it; nobody waits).
  FrameSlot* acquire();
  // Gives a slot back that acquire() returned; nullptr is ignored.
  void release(FrameSlot* slot);

  std::size_t capacity() const { return slot_count_; }
  std::size_t in_use() const { return in_use_.load(std::memory_order_relaxed); }
  std::size_t high_water() const { return high_water_.load(std::memory_order_relaxed); }

 private:
  std::size_t slot_count_;
  std::unique_ptr<FrameSlot[]> slots_;
  std::unique_ptr<std::atomic<bool>[]> taken_;
  std::unique_ptr<std::byte, void (*)(std::byte*)> memory_;
  std::atomic<std::size_t> in_use_{0};
  std::atomic<std::size_t> high_water_{0};
};

// Why a sensor has or has not a frame at an instant.
enum class FrameState : std::uint8_t {
  kAbsent,    // no such sensor in the rig
  kPresent,   // here, with its skew
  kNotDue,    // its rate is below the tick of the FrameSets
  kLate,      // due, may still come
  kLost,      // due, will not come: the sensor is silent or unplugged
  kDamaged,   // came with lost packets and was dropped
  kUnusable,  // came, but too dark or too bright to say anything
};

struct SensorFrame {
  FrameState state = FrameState::kAbsent;
  const FrameSlot* slot = nullptr;  // not null exactly when state is kPresent
  Duration skew{};                  // slot->instant - FrameSet::instant
};

// The frames of one instant. A view: whoever grouped it keeps the slots until it is processed.
struct FrameSet {
  std::uint64_t index = 0;
  HostTime instant{};
  std::array<SensorFrame, kSensorsMax> sensors{};  // by sensor index of the Rig
};

}  // namespace wagonsight
