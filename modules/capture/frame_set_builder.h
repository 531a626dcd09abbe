#pragma once

#include <optional>
#include <span>

#include "capture/frame_grouping.h"

namespace wagonsight {

// Groups frames of many sensors into FrameSets, one for each frame of the fastest sensor.
//
// The reference is the sensor with the shortest measured period of those that are not silent (it
// keeps that part until another is a quarter faster). Each of its frames makes a tick. Where it
// missed one, or before it is lost, other sensors' frames get a tick of their own at the instant
// that its frame would have made. So a recording of one camera gives exactly one FrameSet a frame,
// whatever its rate.
//
// A tick lies at the mid-phase: of all sensors of the reference's rate, which nobody can trigger,
// the phases are cut at their widest gap, and the tick is the middle of the rest. Then n such
// sensors spread over at most (1 - 1/n) P, half of it to either side; on the reference's own frame
// they could be up to P/2 away on both sides. The cut moves, and may cost a frame, when another gap
// has become clearly wider, or has been wider for a second.
//
// At tick t with period P a sensor's frame is the one nearest to t in (t - P, t + P/2): older ones
// were late, newer ones belong to the next tick. Nearest with a little inertia: a frame less than
// 0.6 P old is taken before a newer one, so that a sensor half a period out of step keeps every
// frame in spite of jitter. A frame is used at most once. A set is handed out when no sensor can
// contribute a better frame any more, or at t + P/2 + latency_max:
//
//     kPresent   slot and skew                     kDamaged   a damaged frame was the only one
//     kNotDue    its next frame belongs to a later tick
//     kLate      due, not here                     kLost      silent
//     kAbsent    no such sensor
//
// One thread; never allocates. FrameBarrier is its twin, as the paper does it.
class FrameSetBuilder final : public FrameGrouping {
 public:
  // As make_frame_grouping().
  FrameSetBuilder(FramePool& pool, std::span<const double> rates_hz,
                  const FrameSetOptions& options = {})
      : FrameGrouping(pool, rates_hz, options) {}

  bool next(HostTime now, FrameSet& set) override;

 private:
  static constexpr int kGapTick = -1;     // the reference missed its frame
  static constexpr int kSilentTick = -2;  // nobody has a frame

  struct Tick {
    HostTime instant{};
    Duration period{};
    int reference = kGapTick;  // the sensor whose frame defines it
  };

  int choose_reference() const;
  std::optional<Tick> find_tick();
  std::optional<Tick> find_gap_tick(const Tick& regular, const Entry* reference_frame) const;
  std::optional<Tick> find_silent_tick() const;
  bool deadline_passed(const Tick& tick) const;
  bool settled(const Tick& tick) const;
  bool settled(const SensorQueue& queue, const Tick& tick) const;
  void emit(const Tick& tick, FrameSet& set);
  void plan_phase();
  SensorFrame take_nearest(SensorQueue& queue, const Tick& tick);
  bool missing(const SensorQueue& queue, const Tick& tick) const;

  int reference_ = -1;
  int planned_reference_ = -1;  // whose frames phase_ counts from
  Duration phase_{};            // from the reference's frame to its tick
  int wider_for_ = 0;           // ticks during which another gap was the widest
  std::optional<Tick> last_tick_;
};

}  // namespace wagonsight
