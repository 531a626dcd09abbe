#include "common/grouping_options.h"

namespace wagonsight {

FrameSetOptions grouping_options(const CaptureSettings& settings, const Rig& rig) {
  FrameSetOptions options;
  options.stamp_delays = stamp_delays(rig);
  options.grouping = settings.grouping == "barrier" ? Grouping::kBarrier : Grouping::kHardware;
  options.barrier_timer = from_seconds(1 / settings.barrier_hz);
  return options;
}

}  // namespace wagonsight
