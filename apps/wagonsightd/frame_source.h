#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "base/capacities.h"
#include "base/spsc_ring.h"
#include "capture/sensor.h"
#include "frame/frame.h"

namespace wagonsight {

// A Sensor, and which sensors of the rig its slots belong to. A recording is one source of several.
struct FrameSource {
  std::unique_ptr<Sensor> sensor;
  // By the sensor index that the source writes into its slots; kNone: not wanted, given back.
  static constexpr std::uint8_t kNone = 0xFF;
  std::array<std::uint8_t, kSensorsMax> rig_index{};
  // Renders or decodes what a device would deliver by itself, so it goes after the tracking.
  bool is_background_work = false;
  bool allocates = false;  // a decoder's buffers; its thread is not sealed
  // Waits for a device, whose next packets come whether they are fetched or not.
  bool is_device = false;
};

// Is shown every frame of the rig's sensors by their threads before the tracking has it, and keeps
// none. Must be quick.
class FrameWitness {
 public:
  virtual ~FrameWitness() = default;
  virtual void offer(const FrameSlot& frame) = 0;
};

// Tells the tracking thread that there are frames; never blocks the teller.
class FrameBell {
 public:
  FrameBell();
  ~FrameBell();
  FrameBell(const FrameBell&) = delete;
  FrameBell& operator=(const FrameBell&) = delete;
  void ring();
  void wait(Duration timeout);

 private:
  int fd_;
};

// The thread of one source: polls it until told to stop, and hands its slots on.
class SourceThread {
 public:
  SourceThread(FrameSource source, FramePool& pool, FrameBell& bell,
               FrameWitness* witness = nullptr);
  ~SourceThread();  // stops
  SourceThread(const SourceThread&) = delete;
  SourceThread& operator=(const SourceThread&) = delete;

  void start();
  void stop();

  std::string_view name() const { return source_.sensor->name(); }
  // Rises while the thread is not stuck in its sensor.
  std::uint64_t turns() const { return turns_.load(std::memory_order_relaxed); }
  bool ended() const { return ended_.load(std::memory_order_acquire); }
  const std::array<std::uint8_t, kSensorsMax>& rig_index() const { return source_.rig_index; }

  // For the tracking thread only: the next slot, its sensor_index that of the rig; nullptr: none.
  FrameSlot* take();

  // Whether this sensor, and no other one, is read by this thread.
  bool is_only_source_of(std::size_t sensor_index) const;
  void set_exposure(const Exposure& exposure) { source_.sensor->set_exposure(exposure); }

  struct Counters {
    std::uint64_t frames = 0, dropped = 0, damaged = 0, resets = 0;
  };
  Counters counters() const;         // any thread
  std::string_view trouble() const;  // as Sensor's, any thread

 private:
  void run();
  void hand_on();
  void tell_counters();

  FrameSource source_;
  FramePool& pool_;
  FrameBell& bell_;
  FrameWitness* witness_;
  SpscRing<FrameSlot*> own_ring_;  // from the sensor, within this thread
  SpscRing<FrameSlot*> ring_;      // to the tracking
  std::uint64_t overrun_ = 0;      // frames that the tracking did not take in time
  std::atomic<bool> stop_{false}, ended_{false};
  std::atomic<std::uint64_t> turns_{0};
  std::atomic<const char*> trouble_{nullptr};
  std::atomic<std::uint64_t> frames_{0}, dropped_{0}, damaged_{0}, resets_{0};
  std::thread thread_;
};

}  // namespace wagonsight
