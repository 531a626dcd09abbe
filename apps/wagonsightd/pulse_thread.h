#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <thread>

#include "capture/trigger_plan.h"

namespace wagonsight {

// The thread that triggers cameras. `last_tick` tells the instant of the newest FrameSet, zero
// before the first.
class PulseThread {
 public:
  PulseThread(std::unique_ptr<PulseSource> pulses, std::function<HostTime()> last_tick)
      : pulses_(std::move(pulses)), last_tick_(std::move(last_tick)) {}
  ~PulseThread() { stop(); }
  PulseThread(const PulseThread&) = delete;
  PulseThread& operator=(const PulseThread&) = delete;

  void start();  // nothing when there is nothing to trigger
  void stop();

 private:
  void run();

  std::unique_ptr<PulseSource> pulses_;
  std::function<HostTime()> last_tick_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace wagonsight
