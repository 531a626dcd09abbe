#pragma once

#include <cstdint>

#include "capture/clock_fit.h"

namespace wagonsight {

inline constexpr double kFireTicksPerSecond = 24'576'000;

// The clock of an IEEE 1394 bus, which all its nodes share, against the host's: readings of both
// at once (which the kernel takes within a microsecond) go through the clock fit, so that the time
// of a packet does not depend on when the host heard of it.
//
// A bus tells time in seconds modulo 128, cycles of 125 us and 3072nds of them; a packet's stamp
// only seconds modulo 8 and cycles. One thread; never allocates.
class BusClock {
 public:
  // A reading: the cycle timer's 32 bits, and the host's time when it showed them. At least every
  // two minutes, and within four seconds of the packets that are asked for.
  void observe(std::uint32_t timer, HostTime host) {
    constexpr std::uint64_t kRange = 128ULL * 24'576'000;
    const std::uint64_t cycles = std::uint64_t{timer >> 25U} * 8000 + (timer >> 12U & 0x1fffU);
    const std::uint64_t raw = cycles * 3072 + (timer & 0xfffU);
    ticks_ = has_started_ ? ticks_ + (raw + kRange - ticks_ % kRange) % kRange : kRange + raw;
    has_started_ = true;
    fit_.observe(ticks_, host);
  }

  // The unwrapped ticks (24.576 MHz) at which the cycle of a packet's stamp began.
  std::uint64_t ticks_of(std::uint16_t stamp) const {
    constexpr std::int64_t kRange = 8 * 8000;
    const std::int64_t cycle = (stamp >> 13U) * 8000 + (stamp & 0x1fffU);
    const auto now = static_cast<std::int64_t>(ticks_ / 3072);
    std::int64_t since = (cycle - now % kRange + kRange) % kRange;
    if (since > kRange / 2) since -= kRange;
    return static_cast<std::uint64_t>(now + since) * 3072;
  }

  HostTime to_host(std::uint64_t ticks) const { return fit_.to_host(ticks); }
  bool has_started() const { return has_started_; }
  double drift_ppm() const { return fit_.drift_ppm(); }

 private:
  // Readings are so tight that two seconds of them tell the drift.
  ClockFit fit_{{kFireTicksPerSecond, {}, 500, 2.0}};
  std::uint64_t ticks_ = 0;
  bool has_started_ = false;
};

}  // namespace wagonsight
