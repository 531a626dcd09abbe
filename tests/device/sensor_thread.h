#pragma once

#include <atomic>
#include <string>
#include <string_view>
#include <thread>

#include "capture/sensor.h"
#include "linux/sealed_heap.h"
#include "virtual_time.h"

namespace wagonsight::device {

// A sensor in a thread of its own, as in the daemon, but in virtual time. Its heap is sealed.
class SensorThread {
 public:
  SensorThread(Sensor& sensor, FramePool& pool) : sensor_(sensor), pool_(pool) {
    // The thread must count as an actor before time can go on without it.
    std::atomic<bool> acts{false};
    thread_ = std::thread([this, &acts] { run(acts); });
    while (!acts) std::this_thread::yield();
  }
  ~SensorThread() { stop(); }
  SensorThread(const SensorThread&) = delete;
  SensorThread& operator=(const SensorThread&) = delete;

  void stop() {
    stop_ = true;
    const VirtualTime::Absence away;
    if (thread_.joinable()) thread_.join();
  }
  FrameSlot* take() {
    FrameSlot* slot = nullptr;
    return ring_.try_pop(slot) ? slot : nullptr;
  }
  // As the sensor last said.
  std::string trouble() const { return trouble_ == nullptr ? "" : trouble_.load(); }
  // When it first said so, after `start`; kNever.
  Nanoseconds trouble_since() const { return trouble_since_; }
  void forget_trouble() { trouble_since_ = VirtualTime::kNever; }

 private:
  void run(std::atomic<bool>& acts) {
    const VirtualTime::Actor actor;
    acts = true;
    const HeapSeal seal;
    while (!stop_) {
      sensor_.poll(std::chrono::milliseconds(50), pool_, ring_);
      const std::string_view now = sensor_.trouble();
      trouble_ = now.empty() ? nullptr : now.data();
      if (!now.empty() && trouble_since_ == VirtualTime::kNever)
        trouble_since_ = VirtualTime::instance().now();
    }
  }

  Sensor& sensor_;
  FramePool& pool_;
  SpscRing<FrameSlot*> ring_{64};
  std::atomic<bool> stop_{false};
  std::atomic<const char*> trouble_{nullptr};
  std::atomic<Nanoseconds> trouble_since_{VirtualTime::kNever};
  std::thread thread_;
};

}  // namespace wagonsight::device
