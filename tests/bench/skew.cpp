#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "bench/capture_bench.h"
#include "capture/clock_fit.h"
#include "capture/frame_grouping.h"
#include "capture/trigger_plan.h"

// Virtual time: devices with clocks of their own, the clock fits of the drivers, and one of the two
// groupings. The truth, which no grouping sees, judges their sets.
namespace wagonsight::bench {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr double kKinectPeriod_s = 1.0 / 30;
constexpr double kKinectDelay_s = 0.033;  // from the light to a frame's last packet
constexpr double kStereoPeriod_s = 1 / 14.2;
constexpr double kStereoPulses_s = 0.075;  // the least from a pulse to the next
constexpr double kStereoDelay_s = 0.0713;  // half the shutter, and a pair's way over a bus of two
constexpr double kHalfShutter_s = 0.001;
constexpr double kCycle_s = 125e-6;          // packets begin with one
constexpr double kBusReadings_s = 0.05;      // the bus's clock is read so often,
constexpr double kBusReadingLate_s = 10e-6;  // its time and the host's so far apart at most
constexpr double kBusWrite_s = 1e-4;         // to trigger one bus after the other; an assumption
constexpr double kWarmUp_s = 30;             // until the clock fits know the drift

struct Shot {
  double light_s = 0, arrival_s = kNever, stated_s = 0;
};

using Random = std::mt19937_64;
double between(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

// A quartz that is off, and what the host believes of it.
class DeviceClock {
 public:
  DeviceClock(double drift_ppm, const ClockFitOptions& fit)
      : rate_(fit.ticks_per_s / (1 + drift_ppm * 1e-6)), fit_(fit) {}

  void hear(double when_s, double heard_s) { fit_.observe(ticks(when_s), at(heard_s)); }
  double stated(double when_s) const {
    return to_seconds(fit_.to_host(ticks(when_s)).time_since_epoch());
  }
  static HostTime at(double s) { return HostTime{} + from_seconds(s); }

 private:
  std::uint64_t ticks(double s) const {
    return static_cast<std::uint64_t>(std::llround((s + 1000) * rate_));
  }
  double rate_;
  ClockFit fit_;
};

class VirtualSensor {
 public:
  VirtualSensor(bool is_stereo, bool is_triggered, double phase, const SkewOptions& options,
                Random& random)
      : is_stereo_(is_stereo),
        readings_(options.readings),
        jitter_s_(options.jitter_ms * 1e-3),
        random_(random()),
        clock_(
            between(random, -options.drift_ppm, options.drift_ppm),
            is_stereo ? ClockFitOptions{24.576e6, {}, 500, 2.0} : ClockFitOptions{60e6, {}, 500}) {
    const double nominal_s = is_stereo ? kStereoPeriod_s : kKinectPeriod_s;
    const double drift = between(random, -options.drift_ppm, options.drift_ppm) * 1e-6;
    period_s_ = nominal_s * (1 + drift);
    first_cycle_s_ = between(random, 0, kCycle_s);
    next_light_s_ = is_triggered ? kNever : 1 + phase * nominal_s;
    is_stereo ? expose_until_sent() : send_kinect_frame();
  }

  const Shot& upcoming() const { return shots_.empty() ? kNothing : shots_.front(); }
  Shot take() {
    const Shot shot = shots_.front();
    shots_.pop_front();
    if (shots_.empty()) is_stereo_ ? expose_until_sent() : send_kinect_frame();
    return shot;
  }
  void trigger(double light_s) { send_pair(light_s); }
  bool is_stereo() const { return is_stereo_; }
  double delay_s() const { return is_stereo_ ? kStereoDelay_s : kKinectDelay_s; }

 private:
  static constexpr Shot kNothing{};

  void expose_until_sent() {
    if (next_light_s_ == kNever) return;
    send_pair(next_light_s_);
    next_light_s_ += period_s_;
  }

  void send_kinect_frame() {
    Shot shot{next_light_s_, 0, 0};
    double packet_s = 0;
    for (int j = readings_ - 1; j >= 0; --j) {
      packet_s = shot.light_s + kKinectDelay_s - period_s_ * j / readings_;
      // What was told late holds up what follows it.
      heard_s_ = std::max(heard_s_, packet_s + between(random_, 0, jitter_s_));
      clock_.hear(packet_s, heard_s_);
    }
    shot.arrival_s = heard_s_;
    shot.stated_s = clock_.stated(packet_s) - kKinectDelay_s;
    next_light_s_ += period_s_;
    shots_.push_back(shot);
  }

  void send_pair(double light_s) {
    const double cycles = std::ceil((light_s + kHalfShutter_s - first_cycle_s_) / kCycle_s);
    const double sent_s = first_cycle_s_ + cycles * kCycle_s;
    for (; read_s_ < sent_s; read_s_ += kBusReadings_s)
      clock_.hear(read_s_, read_s_ + between(random_, 0, kBusReadingLate_s));
    heard_s_ = std::max(heard_s_,
                        sent_s + kStereoDelay_s - kHalfShutter_s + between(random_, 0, jitter_s_));
    shots_.push_back({light_s, heard_s_, clock_.stated(sent_s) - kHalfShutter_s});
  }

  bool is_stereo_;
  int readings_;
  double jitter_s_;
  Random random_;
  DeviceClock clock_;
  double period_s_ = 0, next_light_s_ = kNever;
  double heard_s_ = 0, read_s_ = 0, first_cycle_s_ = 0;
  std::deque<Shot> shots_;
};

struct RigOfSkew {
  std::size_t kinects = 0, stereos = 0;
  bool is_triggered = false;  // the stereo cameras
  Grouping grouping = Grouping::kHardware;
  double timer_hz = 0;
};

// Of the sets that hold all sensors of a kind; milliseconds.
struct Figures {
  std::vector<double> spread, from_instant, by_arrival, by_clock;
};

class Trial {
 public:
  // `phases` of the sensors, as parts of their periods.
  Trial(const RigOfSkew& rig, const std::vector<double>& phases, const SkewOptions& options,
        Random& random, std::array<Figures, 2>& figures)
      : rig_(rig), figures_(figures), pool_(12 * phases.size(), 64) {
    std::vector<double> rates;
    for (std::size_t i = 0; i < phases.size(); ++i) {
      const bool is_stereo = i >= rig.kinects;
      sensors_.emplace_back(is_stereo, is_stereo && rig.is_triggered, phases[i], options, random);
      rates.push_back(is_stereo ? 14.0 : 30.0);
    }
    FrameSetOptions grouping;
    if (rig.stereos > 0) grouping.latency_max = std::chrono::milliseconds(120);  // as the daemon
    grouping.grouping = rig.grouping;
    if (rig.timer_hz > 0) grouping.barrier_timer = from_seconds(1 / rig.timer_hz);
    grouping_ = make_frame_grouping(pool_, rates, grouping);
  }

  void run(double seconds) {
    const double end_s = kWarmUp_s + seconds;
    double now_s = 1;
    while (now_s < end_s) {
      const auto first = std::min_element(sensors_.begin(), sensors_.end(),
                                          [](const VirtualSensor& a, const VirtualSensor& b) {
                                            return a.upcoming().arrival_s < b.upcoming().arrival_s;
                                          });
      const double arrival_s = first->upcoming().arrival_s;
      if (rig_.is_triggered) {
        const HostTime pulse = plan_.next(DeviceClock::at(now_s));
        const double pulse_s = to_seconds(pulse.time_since_epoch());
        if (pulse_s < arrival_s) {
          fire(pulse_s);
          plan_.fired(pulse);
          now_s = pulse_s;
          continue;
        }
      }
      now_s = arrival_s;
      hand_out(now_s);
      add(static_cast<std::size_t>(first - sensors_.begin()), first->take());
      hand_out(now_s);
    }
  }

 private:
  // Two cameras a bus.
  void fire(double pulse_s) {
    for (std::size_t i = rig_.kinects; i < sensors_.size(); ++i) {
      const auto bus = static_cast<double>((i - rig_.kinects) / 2);
      sensors_[i].trigger(pulse_s + kBusWrite_s * (bus + 1) + kHalfShutter_s);
    }
  }

  void add(std::size_t i, const Shot& shot) {
    FrameSlot* const slot = pool_.acquire();
    slot->sensor_index = static_cast<std::uint8_t>(i);
    slot->instant = DeviceClock::at(shot.stated_s);
    slot->arrival = DeviceClock::at(shot.arrival_s);
    // No grouping looks at the ticks: here they carry the truth.
    slot->device_ticks = static_cast<std::uint64_t>(from_seconds(shot.light_s).count());
    grouping_->add(slot);
  }

  void hand_out(double now_s) {
    FrameSet set;
    while (grouping_->next(DeviceClock::at(now_s), set)) {
      if (rig_.kinects > 0 && set.sensors[0].state == FrameState::kPresent)
        plan_.observe(set.instant);
      if (now_s < kWarmUp_s) continue;
      judge(set, 0, rig_.kinects, figures_[0]);
      judge(set, rig_.kinects, sensors_.size(), figures_[1]);
    }
  }

  struct Range {
    double low = kNever, high = -kNever;
    void add(double x) { low = std::min(low, x), high = std::max(high, x); }
    double ms() const { return 1e3 * (high - low); }
  };

  void judge(const FrameSet& set, std::size_t begin, std::size_t end, Figures& figures) {
    if (begin == end) return;
    Range lights, arrivals, errors;
    double from_instant_s = 0;
    for (std::size_t i = begin; i < end; ++i) {
      const FrameSlot* const slot = set.sensors[i].slot;
      if (slot == nullptr) return;
      const double light_s = static_cast<double>(slot->device_ticks) * 1e-9;
      lights.add(light_s);
      arrivals.add(to_seconds(slot->arrival.time_since_epoch()) - sensors_[i].delay_s() - light_s);
      errors.add(to_seconds(slot->instant.time_since_epoch()) - light_s);
      from_instant_s =
          std::max(from_instant_s, std::abs(light_s - to_seconds(set.instant.time_since_epoch())));
    }
    figures.spread.push_back(lights.ms());
    figures.from_instant.push_back(1e3 * from_instant_s);
    figures.by_arrival.push_back(arrivals.ms());
    figures.by_clock.push_back(errors.ms());
  }

  RigOfSkew rig_;
  std::array<Figures, 2>& figures_;
  FramePool pool_;
  std::vector<VirtualSensor> sensors_;
  std::unique_ptr<FrameGrouping> grouping_;
  TriggerPlan plan_{{from_seconds(kStereoPulses_s), from_seconds(kBusWrite_s + kHalfShutter_s)}};
};

double share(std::vector<double>& values, double part) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

void tell(const std::string& sensors, const std::string& grouping, Figures& figures,
          double seconds) {
  if (figures.spread.empty()) return;
  fmt::print("| {} | {} | {:.1f} Hz | {:.1f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} |\n",
             sensors, grouping, static_cast<double>(figures.spread.size()) / seconds,
             share(figures.spread, 0.5), share(figures.spread, 0.99), share(figures.spread, 1),
             share(figures.from_instant, 0.99), share(figures.by_arrival, 0.99),
             share(figures.by_clock, 0.99));
  std::fflush(stdout);
}

// Every fifth trial has its sensors at equal distances, which is the worst for a cut.
std::vector<double> phases_of(const RigOfSkew& rig, int trial, Random& random) {
  std::vector<double> phases(rig.kinects + rig.stereos);
  for (std::size_t i = 0; i < phases.size(); ++i) {
    const bool is_kinect = i < rig.kinects;
    const double count = static_cast<double>(is_kinect ? rig.kinects : rig.stereos);
    const double number = static_cast<double>(is_kinect ? i : i - rig.kinects);
    phases[i] = trial % 5 == 0 ? number / count : between(random, 0, 1);
  }
  return phases;
}

void run_rig(const RigOfSkew& rig, const SkewOptions& options) {
  Random random(options.seed);
  std::array<Figures, 2> figures;
  for (int i = 0; i < options.trials; ++i)
    Trial(rig, phases_of(rig, i, random), options, random, figures).run(options.seconds);
  const std::string grouping = rig.grouping == Grouping::kHardware
                                   ? "hardware"
                                   : fmt::format("barrier, {:.0f} Hz", rig.timer_hz);
  const bool is_mixed = rig.kinects > 0 && rig.stereos > 0;
  const double seconds = options.seconds * options.trials;
  tell(fmt::format("{} Kinects{}", rig.kinects, is_mixed ? " (of all)" : ""), grouping, figures[0],
       seconds);
  tell(fmt::format("{} stereo, {}{}", rig.stereos,
                   rig.is_triggered ? "triggered together" : "free-running",
                   is_mixed ? " (of all)" : ""),
       grouping, figures[1], seconds);
}

}  // namespace

Result<void> run_skew(const SkewOptions& options) {
  if (options.trials < 1 || options.seconds <= 0 || options.readings < 1)
    return fail("trials, seconds and readings must be more than none");
  fmt::print(
      "{} trials of {:.0f} s at random phases; quartzes off by up to {:.0f} ppm, arrivals late by "
      "up to {:.0f} ms,\na Kinect's clock told {} times a frame. Milliseconds; skew known: p99 of "
      "a set's largest error in what is said of its\nsensors' light to each other. The paper says "
      "nothing of it, so its error is the spread.\n\n",
      options.trials, options.seconds, options.drift_ppm, options.jitter_ms, options.readings);
  fmt::print(
      "| sensors | grouping | whole sets | spread of the light: median | p99 | most | from the "
      "set's instant, p99 | skew known by arrival | by the clocks |\n"
      "|---|---|---|---|---|---|---|---|---|\n");
  constexpr auto kBarrier = Grouping::kBarrier;
  for (const RigOfSkew& rig :
       {RigOfSkew{4, 0, false, kBarrier, 19}, RigOfSkew{4, 0}, RigOfSkew{0, 6, false, kBarrier, 14},
        RigOfSkew{0, 6, true}, RigOfSkew{4, 6, false, kBarrier, 14}, RigOfSkew{4, 6, true}})
    run_rig(rig, options);
  return {};
}

}  // namespace wagonsight::bench
