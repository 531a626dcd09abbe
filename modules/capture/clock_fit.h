#pragma once

#include <cstdint>
#include <optional>

#include "base/fixed_vector.h"
#include "base/time.h"

namespace wagonsight {

struct ClockFitOptions {
  double ticks_per_s = 1e6;  // the device's clock, nominally
  // From the light to the earliest possible arrival of the frame: what arrival times cannot reveal.
  // Calibrated per kind of device.
  Duration latency_min{};
  double drift_ppm_max = 500;  // a quartz that is worse is broken
  // Until there are points of so many seconds the drift counts as zero: the later the arrivals may
  // be, the longer.
  double baseline_s = 10.0;
};

// When was the light taken? Fits a device's clock to the host's.
//
// A frame (or a packet of one: the more often the clock is told, the tighter the line) with device
// time x (seconds since the first, nominal) arrives at
//
//     a = offset + (1 + drift) x + latency_min + late,        late >= 0
//
// The lateness is one-sided (scheduling, bus, driver), so the line is the lower envelope of the
// points (x, a), not their regression: the edge of their lower convex hull below the mean of x,
// which minimises the sum of all lateness under late >= 0 (Moon, Skelly and Towsley, INFOCOM 1999;
// by convex hull: Zhang, Liu and Xia, INFOCOM 2002). In fixed memory: the least late point of each
// two seconds is kept, of the last two minutes, so a drift that follows the temperature is
// followed. Until there are points of `baseline_s` the drift counts as zero.
//
// A frame that is earlier than the line moves the line at once, so an instant never lies after its
// arrival. Ticks that run backwards, or times that no drift explains (0.1 s early, or every frame
// of two seconds 0.5 s late), mean that the device restarted: the fit starts again, counted.
//
// One thread; never allocates; its result depends on its input alone.
class ClockFit {
 public:
  explicit ClockFit(const ClockFitOptions& options) : options_(options) {}

  // Takes in one frame or packet and returns the instant of its light. `ticks` are unwrapped.
  HostTime observe(std::uint64_t ticks, HostTime arrival);

  // Host time of any device time near those observed; valid after the first observe().
  HostTime to_host(std::uint64_t ticks) const;

  bool has_started() const { return started_; }
  // Of the device against the host's clock: positive when the device's clock is slow.
  double drift_ppm() const { return drift_ * 1e6; }
  // How late the last frame came behind the earliest possible arrival.
  Duration last_lateness() const { return last_lateness_; }
  std::uint64_t restarts() const { return restarts_; }

 private:
  struct Point {
    double x = 0;         // device seconds since the origin
    double residual = 0;  // (arrival - origin) - x
  };
  static constexpr std::size_t kPointsMax = 60;
  static constexpr double kBin_s = 2.0;

  void restart(std::uint64_t ticks, HostTime arrival);
  double device_seconds(std::uint64_t ticks) const;
  double line(double x) const { return anchor_.residual + drift_ * (x - anchor_.x); }
  void close_bin();
  void fit();

  ClockFitOptions options_;
  bool started_ = false;
  std::uint64_t origin_ticks_ = 0, last_ticks_ = 0;
  HostTime origin_{};
  FixedVector<Point, kPointsMax> points_;  // the least late of each bin, by x
  std::optional<Point> bin_least_;         // of the bin that is being filled
  double bin_begin_ = 0;
  double bin_lateness_least_ = 0;
  Point anchor_;  // on the line
  double drift_ = 0;
  Duration last_lateness_{};
  std::uint64_t restarts_ = 0;
};

// Makes a counter of few bits (a Kinect's has 32 at 60 MHz: 71 s) one that never wraps. A step of
// more than half the range counts as backwards and is reported as the step that it is.
class TickUnwrapper {
 public:
  explicit TickUnwrapper(unsigned bits) : mask_(bits >= 64 ? ~0ULL : (1ULL << bits) - 1) {}

  std::uint64_t unwrap(std::uint64_t raw) {
    raw &= mask_;
    if (!started_) {
      started_ = true;
      // One range above zero, so that a step backwards has room.
      ticks_ = mask_ == ~0ULL ? raw : raw + mask_ + 1;
      return ticks_;
    }
    const std::uint64_t forward = (raw - ticks_) & mask_;
    if (forward <= mask_ / 2)
      ticks_ += forward;
    else
      ticks_ -= mask_ - forward + 1;
    return ticks_;
  }

 private:
  std::uint64_t mask_;
  std::uint64_t ticks_ = 0;
  bool started_ = false;
};

}  // namespace wagonsight
