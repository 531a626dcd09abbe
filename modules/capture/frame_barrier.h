#pragma once

#include <array>
#include <optional>
#include <span>

#include "capture/frame_grouping.h"

namespace wagonsight {

// Groups frames as the paper does (section 2.1): a timer gives a signal, every sensor's thread
// takes an image, a barrier waits for all of them, and then the timer gives the next signal.
//
//              first image            all have come, or the longest wait is over
//     [idle] -------------> [taking] --------------------------------------------> a FrameSet
//        ^                   |    ^                                                     |
//        +-------------------+    +-----------------------------------------------------+
//      nobody came and empty          the next signal: a timer's period after the last,
//      sets are not wanted            or when the barrier opened, whichever is later
//
// A sensor's image is its first whose arrival is not before the signal; those between two signals
// are thrown away. So the rate is at most the timer's, and the images of a set are as far apart as
// the phases of their sensors happen to be: by how much, against the sets that the devices' clocks
// make (FrameSetBuilder), is in the README.
//
// Beyond the paper:
//   - the barrier waits at most for the longest period of the sensors and latency_max, so that a
//     lost sensor hangs nobody; for a silent one it does not wait at all;
//   - the sensors' own clocks still tell each frame's light: a set's instant is the middle between
//     its first light and its last, and skews are stated, so that motion can be compensated;
//   - damaged, late, repeated and disordered frames are known and counted.
//
// A FrameSet has kPresent, kDamaged (its image was), kLate (did not come while the barrier waited),
// kLost (silent) and kAbsent; every sensor is due at every signal. One thread; never allocates.
class FrameBarrier final : public FrameGrouping {
 public:
  // As make_frame_grouping().
  FrameBarrier(FramePool& pool, std::span<const double> rates_hz,
               const FrameSetOptions& options = {})
      : FrameGrouping(pool, rates_hz, options) {}

  bool next(HostTime now, FrameSet& set) override;

 private:
  void give_first_signal();
  void discard_before_signal();
  bool anybody_came() const;
  bool everybody_came() const;
  HostTime deadline() const;
  HostTime instant_of_answers() const;
  void emit(FrameSet& set);
  SensorFrame take(std::size_t sensor_index, HostTime instant);

  std::optional<HostTime> signal_;              // nothing: idle
  std::array<bool, kSensorsMax> was_missed_{};  // by the last set: what comes next is late
  std::optional<HostTime> last_instant_;
};

}  // namespace wagonsight
