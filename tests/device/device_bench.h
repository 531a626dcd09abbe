#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "capture/sensor.h"
#include "sensor_thread.h"

namespace wagonsight::device {

// Some emulated devices of one kind and the sensors that drive them, all in virtual time. Every
// pixel of every frame is held against what was sent. Several benches may stand in one thread.
class DeviceBench {
 public:
  virtual ~DeviceBench();
  DeviceBench(const DeviceBench&) = delete;
  DeviceBench& operator=(const DeviceBench&) = delete;

  // Takes over each frame after its check, damaged ones too, and gives it back to pool().
  using Taker = std::function<void(FrameSlot* slot)>;
  void hand_on(Taker taker) { taker_ = std::move(taker); }
  FramePool& pool() { return pool_; }
  // Where not run() does it.
  void take_frames();

  void run(double seconds);
  // Runs until the sensor delivers a good frame, or so long; how long it took, or a negative
  // number.
  double run_until_frame(std::size_t unit, double seconds_max);
  static void script(double in_seconds, std::function<void()> deed);
  SensorThread& thread(std::size_t index) { return *threads_[index]; }

  struct Delivery {
    std::uint32_t number = 0;  // of the unit's frame
    HostTime instant{}, arrival{};
  };
  struct Log {
    std::vector<Delivery> good;
    std::uint64_t damaged = 0;
    std::uint64_t wrong_pixels = 0;
    std::uint64_t unknown = 0;  // that the unit never sent
  };
  const Log& log(std::size_t unit) const { return logs_[unit]; }
  // Of the frames that were sent whole since the first good one (and before the last one): those
  // that were not delivered. Of those delivered: those that were not sent whole, or came twice.
  struct Balance {
    std::uint64_t whole = 0, missing = 0, delivered_damaged = 0, repeated = 0;
  };
  Balance balance(std::size_t unit) const;

 protected:
  DeviceBench(std::size_t slots, std::size_t slot_bytes) : pool_(slots, slot_bytes) {}
  void drive(Sensor& sensor);  // one a unit, in their order
  // Ends the threads; derived classes do so before their sensors go.
  void stop();

  struct SentFrame {
    std::uint32_t number = 0;
    bool whole = false;
  };
  virtual std::vector<SentFrame> sent_frames(std::size_t unit) const = 0;
  // Checks a good frame's pixels.
  virtual void check(std::size_t unit, const FrameSlot& slot, Log& log) = 0;

 private:
  // The first bench of a thread makes it an actor.
  struct MaybeActor {
    MaybeActor() {
      if (!VirtualTime::this_thread_acts()) actor.emplace();
    }
    std::optional<VirtualTime::Actor> actor;
  };
  MaybeActor actor_;
  Taker taker_;
  FramePool pool_;
  std::vector<std::unique_ptr<SensorThread>> threads_;
  std::vector<Log> logs_;
};

}  // namespace wagonsight::device
