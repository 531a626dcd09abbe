#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "base/capacities.h"
#include "base/fixed_vector.h"
#include "frame/frame.h"

namespace wagonsight {

enum class Grouping : std::uint8_t {
  kHardware,  // by the instants of the light: FrameSetBuilder
  kBarrier,   // by a timer and a barrier, as the paper does: FrameBarrier
};

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
  // Of make_frame_grouping(), and the barrier's alone.
  Grouping grouping = Grouping::kHardware;
  Duration barrier_timer = std::chrono::microseconds(52'632);  // 19 Hz
};

// Takes the frames of many sensors and hands out FrameSets. What both ways of grouping have in
// common: a queue a sensor, what is refused and counted, and who is silent.
//
// What is decided depends on the calls alone, so the same calls give the same sets. One thread;
// never allocates.
class FrameGrouping {
 public:
  virtual ~FrameGrouping();
  FrameGrouping(const FrameGrouping&) = delete;
  FrameGrouping& operator=(const FrameGrouping&) = delete;

  // Takes over a slot of the pool. Frames of one sensor come in their order; a frame that cannot be
  // used is released at once and counted. When a sensor's queue is full its oldest frame goes.
  void add(FrameSlot* slot);

  // The next FrameSet that is ready at `now`, or false. Its slots stay valid until the next call of
  // next(), which gives them back to the pool; call until false. `now` is host time: live the
  // clock; in a replay the arrival of the frame that is about to be added (then next() before and
  // after add(), so that silence is seen as it was) or was just added.
  virtual bool next(HostTime now, FrameSet& set) = 0;

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
    std::uint64_t late = 0;        // came when its set was gone
    std::uint64_t superseded = 0;  // another frame of the sensor was taken in its stead
    std::uint64_t overrun = 0;     // sets were not taken in time
  };
  const Counters& counters(std::size_t sensor_index) const { return state(sensor_index).counters; }
  std::uint64_t set_count() const { return set_count_; }

 protected:
  static constexpr std::size_t kQueueMax = 8;       // a quarter of a second at 30 Hz
  static constexpr std::size_t kPeriodsMax = 7;     // median of so many: three drops do not matter
  static constexpr std::size_t kPeriodsNeeded = 3;  // until a period counts as measured

  struct Entry {
    FrameSlot* slot = nullptr;  // nullptr: damaged, only its times are of use
    HostTime instant{};
    HostTime arrival{};
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

  FrameGrouping(FramePool& pool, std::span<const double> rates_hz, const FrameSetOptions& options);

  const SensorQueue& state(std::size_t sensor_index) const;
  bool silent(const SensorQueue& queue) const;
  void drop_front(SensorQueue& queue, std::uint64_t& cause);
  // The first frame of a queue, for the set that is being handed out; nullptr: it is damaged.
  FrameSlot* take_front(SensorQueue& queue);
  void release_current();

  FramePool& pool_;
  FrameSetOptions options_;
  std::array<SensorQueue, kSensorsMax> queues_{};
  HostTime now_{};
  bool finished_ = false;
  std::uint64_t set_count_ = 0;

 private:
  static void measure_period(SensorQueue& queue, Duration step);

  FixedVector<FrameSlot*, kSensorsMax> current_;  // slots of the set that was handed out last
  std::optional<HostTime> started_;
};

// The grouping that `options` ask for. `rates_hz` by sensor index: the nominal rate of each sensor,
// 0 where there is none; measured rates take over after a few frames. `pool` gets the slots back
// and must outlive the grouping.
std::unique_ptr<FrameGrouping> make_frame_grouping(FramePool& pool,
                                                   std::span<const double> rates_hz,
                                                   const FrameSetOptions& options);

}  // namespace wagonsight
