#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "capture/trigger_plan.h"

namespace wagonsight {

struct TriggerLineOptions {
  std::vector<std::uint64_t> guids;  // of the cameras, which were opened for kSoftware
  TriggerPlanOptions plan;
};

// Triggers the cameras of all buses at one instant, by one write a bus that reaches all nodes of it
// (libdc1394's broadcast), when TriggerPlan says so. Through one camera of each bus; where that one
// is gone, through another, within a second. A device that does not answer holds it for two.
class TriggerLine final : public PulseSource {
 public:
  explicit TriggerLine(TriggerLineOptions options);
  ~TriggerLine() override;
  TriggerLine(const TriggerLine&) = delete;
  TriggerLine& operator=(const TriggerLine&) = delete;

  void observe(HostTime tick) override { tick_.store(tick.time_since_epoch().count()); }
  // Does not allocate but when it opens a camera.
  void poll(Duration timeout) override;

  struct Counters {
    std::uint64_t pulses = 0, failed = 0, opened = 0;  // by bus
  };
  Counters counters() const { return counters_; }

 private:
  class Bus;
  void open_missing(HostTime now);
  void fire();

  TriggerLineOptions options_;
  TriggerPlan plan_;
  std::atomic<std::int64_t> tick_{0};
  std::int64_t tick_seen_ = 0;
  HostTime next_look_{};
  std::vector<std::unique_ptr<Bus>> buses_;
  Counters counters_;
};

}  // namespace wagonsight
