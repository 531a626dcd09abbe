#pragma once

#include <cstdint>
#include <string_view>

#include "base/result.h"
#include "base/spsc_ring.h"
#include "frame/frame.h"

namespace wagonsight {

// A source of frames: a device, a recording or a simulation. Its thread calls poll() in a loop; it
// fills slots of the pool and hands them on by the ring. One consumer.
class Sensor {
 public:
  virtual ~Sensor() = default;

  virtual std::string_view name() const = 0;
  // Waits at most `timeout` for what the source has to say, pushes finished frames into `frames`. A
  // frame for which there is no slot or no room in the ring is dropped and counted. False when the
  // source has ended (a recording) or is gone (a device; reopen decides what then).
  virtual bool poll(Duration timeout, FramePool& pool, SpscRing<FrameSlot*>& frames) = 0;

  // Asks for the shutter and gain of the next images of this source's sensor; for cameras that have
  // them, others take no notice. Any thread.
  virtual void set_exposure([[maybe_unused]] const Exposure& exposure) {}

  // `damaged`: every frame that did not come whole, whether it was handed on as damaged or not.
  struct Counters {
    std::uint64_t frames = 0, dropped = 0, damaged = 0, resets = 0;
  };
  virtual Counters counters() const = 0;

  // What is wrong with the device and what to do about it, as "wrong; do": a string literal, empty
  // while all is well. By the thread that polls.
  virtual std::string_view trouble() const { return {}; }
};

}  // namespace wagonsight
