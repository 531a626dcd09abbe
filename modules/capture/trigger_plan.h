#pragma once

#include "base/time.h"

namespace wagonsight {

struct TriggerPlanOptions {
  // The cameras take no pulse sooner after another: exposure, readout and what the bus needs.
  Duration camera_period_min = std::chrono::milliseconds(75);
  Duration lead{};                                           // from a pulse to the light
  Duration tick_period = std::chrono::microseconds(33'333);  // nominally; then as observed
};

// When to trigger the cameras that can be, so that their light lies at the ticks of the FrameSets,
// which lie in the middle of the phases of the sensors that cannot be triggered (see
// frame_set_builder.h): each pulse belongs to the first tick that the cameras can meet, so with
// Kinects at 30 Hz and cameras of at most 14 Hz every third tick is met.
//
// A FrameSet is complete about a tenth of a second after its tick, so the ticks are extrapolated:
// phase and period follow what was observed as a phase-locked loop does. Without any observation
// the cameras run at their own pace.
//
// One thread; never allocates; depends on the calls alone.
class TriggerPlan {
 public:
  explicit TriggerPlan(const TriggerPlanOptions& options)
      : options_(options), period_(options.tick_period) {}

  // The instant of a FrameSet to which a sensor of its own pace gave a frame.
  void observe(HostTime tick);
  // When to fire next; not before `now`.
  HostTime next(HostTime now) const;
  void fired(HostTime when) { last_pulse_ = when, has_fired_ = true; }

  Duration tick_period() const { return period_; }

 private:
  TriggerPlanOptions options_;
  Duration period_;
  HostTime tick_{};  // the last one, smoothed
  int unlike_ = 0;   // ticks in a row that fit nothing
  bool has_tick_ = false, has_fired_ = false;
  HostTime last_pulse_{};
};

// What gives pulses to cameras, as Sensor gives frames: its thread calls poll() in a loop.
class PulseSource {
 public:
  virtual ~PulseSource() = default;
  // As TriggerPlan::observe(); any thread.
  virtual void observe(HostTime tick) = 0;
  // Waits for the next pulse and gives it; returns after `timeout` at the latest, but for the time
  // that a device takes to open.
  virtual void poll(Duration timeout) = 0;
};

}  // namespace wagonsight
