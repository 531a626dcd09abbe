#pragma once

#include "simulate/simulation.h"
#include "stereo/exposure.h"

namespace wagonsight::bench {

// Draws the simulated stereo camera's next pair into `slot` and lets the exposure law answer it.
inline void draw_and_expose(SimulatedDevice& device, FrameSlot& slot) {
  device.next(slot);
  const auto seen = measure_exposure({slot.bytes.data(), slot.format, slot.width, slot.height}, {},
                                     StereoModel::kFullScale);
  const auto next = next_exposure(seen, {static_cast<double>(slot.exposure.shutter_us),
                                         static_cast<double>(slot.exposure.gain_db)})
                        .next;
  device.set_exposure({static_cast<float>(next.shutter_us), static_cast<float>(next.gain_db)});
}

}  // namespace wagonsight::bench
