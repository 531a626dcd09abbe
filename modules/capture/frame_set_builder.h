#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "base/capacities.h"
#include "base/fixed_vector.h"
#include "frame/frame.h"

namespace wagonsight {

struct FrameSetOptions {
  // From the instant of a frame until the host has it, at the most; who comes later is late.
  Duration latency_max = std::chrono::milliseconds(60);
  // A sensor without a frame for so long (and for at least three of its periods) is lost: nobody
  // waits for it any more.
  Duration silent_after = std::chrono::seconds(1);
  // When every sensor is silent: keep ticking with empty FrameSets, so that people fade and seats
  // become unobserved. Off where a FrameSet must answer to a frame (replay of one camera).
  bool tick_when_silent = false;
  // How much later than its light a sensor's frames are stamped, by sensor index (Rig's
  // StampDelay). It is taken off each frame's instant, once, when the frame is added.
  std::array<Duration, kSensorsMax> stamp_delays{};
};

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
// What is decided depends on the calls alone, so the same calls give the same sets. One thread;
// never allocates.
class FrameSetBuilder {
 public:
  // `rates_hz` by sensor index: the nominal rate of each sensor, 0 where there is none; measured
  // rates take over after a few frames. `pool` gets the slots back and must outlive this.
  FrameSetBuilder(FramePool& pool, std::span<const double> rates_hz,
                  const FrameSetOptions& options = {});
  ~FrameSetBuilder();
  FrameSetBuilder(const FrameSetBuilder&) = delete;
  FrameSetBuilder& operator=(const FrameSetBuilder&) = delete;

  // Takes over a slot of the pool. Frames of one sensor come in their order; a frame that cannot be
  // used is released at once and counted. When a sensor's queue is full its oldest frame goes.
  void add(FrameSlot* slot);

  // The next FrameSet that is ready at `now`, or false. Its slots stay valid until the next call of
  // next(), which gives them back to the pool; call until false. `now` is host time: live the
  // clock; in a replay the arrival of the frame that is about to be added (then next() before and
  // after add(), so that silence is seen as it was) or was just added.
  bool next(HostTime now, FrameSet& set);

  // No frame will come any more (the end of a recording): next() then waits for nothing.
  void finish() { finished_ = true; }

  // What became of a sensor's frames. received = used + all others below + those still queued.
  struct Counters {
    std::uint64_t received = 0;
    std::uint64_t used = 0;
    std::uint64_t duplicates = 0;    // the same instant again
    std::uint64_t out_of_order = 0;  // older than a frame that came before
    std::uint64_t implausible = 0;   // its instant lies after its arrival: a broken clock fit
    std::uint64_t damaged = 0;
    std::uint64_t late = 0;        // came when its tick had passed
    std::uint64_t superseded = 0;  // another frame was nearer to the tick
    std::uint64_t overrun = 0;     // sets were not taken in time
  };
  const Counters& counters(std::size_t sensor_index) const { return state(sensor_index).counters; }
  std::uint64_t set_count() const { return set_count_; }

 private:
  static constexpr std::size_t kQueueMax = 8;    // a quarter of a second at 30 Hz
  static constexpr int kGapTick = -1;            // the reference missed its frame
  static constexpr int kSilentTick = -2;         // nobody has a frame
  static constexpr std::size_t kPeriodsMax = 7;  // the median of so many: three drops do not matter

  struct Entry {
    FrameSlot* slot = nullptr;  // nullptr: damaged, only its instant is of use
    HostTime instant{};
  };
  struct SensorQueue {
    bool expected = false;
    bool seen = false;
    Duration nominal_period{};
    Duration period{};                       // measured: the median of the last few
    HostTime last_instant{};                 // of the newest frame
    std::optional<HostTime> left_instant{};  // of the frame that left the queue last
    FixedVector<Entry, kQueueMax> entries;   // by instant
    FixedVector<Duration, kPeriodsMax> periods;
    std::size_t period_cursor = 0;
    Counters counters;
  };
  struct Tick {
    HostTime instant{};
    Duration period{};
    int reference = kGapTick;  // the sensor whose frame defines it
  };

  const SensorQueue& state(std::size_t sensor_index) const;
  void measure_period(SensorQueue& queue, Duration step);
  void drop_front(SensorQueue& queue, std::uint64_t& cause);
  bool silent(const SensorQueue& queue) const;
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
  void release_current();

  FramePool& pool_;
  FrameSetOptions options_;
  std::array<SensorQueue, kSensorsMax> queues_{};
  FixedVector<FrameSlot*, kSensorsMax> current_;  // slots of the set that was handed out last
  int reference_ = -1;
  int planned_reference_ = -1;  // whose frames phase_ counts from
  Duration phase_{};            // from the reference's frame to its tick
  int wider_for_ = 0;           // ticks during which another gap was the widest
  std::optional<HostTime> started_;
  std::optional<Tick> last_tick_;
  HostTime now_{};
  bool finished_ = false;
  std::uint64_t set_count_ = 0;
};

}  // namespace wagonsight
