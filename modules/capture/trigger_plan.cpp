#include "capture/trigger_plan.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

// Of an error, what the phase and the period take over at once.
constexpr double kPhaseGain = 0.2, kPeriodGain = 0.02;
// Parts of a period. An error beyond it is another tick, or the cut between the phases has moved.
constexpr double kUnlike = 0.2;
constexpr int kUnlikeMax = 6;
constexpr double kPeriodRange = 0.02;  // how much a measured period may differ from the nominal

}  // namespace

void TriggerPlan::observe(HostTime tick) {
  if (!has_tick_) {
    tick_ = tick;
    has_tick_ = true;
    return;
  }
  const double period_s = to_seconds(period_);
  const double passed = std::round(to_seconds(tick - tick_) / period_s);
  if (passed < 1) return;
  const HostTime expected = tick_ + from_seconds(passed * period_s);
  const double error_s = to_seconds(tick - expected);
  const bool is_unlike = std::abs(error_s) > kUnlike * period_s;
  unlike_ = is_unlike ? unlike_ + 1 : 0;
  if (is_unlike && unlike_ < kUnlikeMax) return;
  if (is_unlike) {  // they mean it
    tick_ = tick;
    unlike_ = 0;
    return;
  }
  tick_ = expected + from_seconds(kPhaseGain * error_s);
  const double nominal_s = to_seconds(options_.tick_period);
  period_ =
      from_seconds(std::clamp(period_s + kPeriodGain * error_s / passed,
                              nominal_s * (1 - kPeriodRange), nominal_s * (1 + kPeriodRange)));
}

HostTime TriggerPlan::next(HostTime now) const {
  HostTime earliest = now;
  if (has_fired_) earliest = std::max(earliest, last_pulse_ + options_.camera_period_min);
  if (!has_tick_) return earliest;
  const double periods =
      std::ceil(to_seconds(earliest + options_.lead - tick_) / to_seconds(period_) - 1e-6);
  return std::max(earliest, tick_ + from_seconds(periods * to_seconds(period_)) - options_.lead);
}

}  // namespace wagonsight
