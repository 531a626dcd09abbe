#pragma once

#include <memory>
#include <string>

#include "base/result.h"
#include "frame_source.h"
#include "rig/rig.h"
#include "wagon/wagon.h"

namespace wagonsight {

// The scene of the settings' [demo] as sensors. Only the demo build links the simulator; in others
// open() says so.
class SimulatedWagon {
 public:
  static Result<SimulatedWagon> open(const std::string& scene_path, std::uint64_t seed);
  SimulatedWagon(SimulatedWagon&&) noexcept;
  SimulatedWagon& operator=(SimulatedWagon&&) noexcept;
  ~SimulatedWagon();
  SimulatedWagon(const SimulatedWagon&) = delete;
  SimulatedWagon& operator=(const SimulatedWagon&) = delete;

  Rig rig() const;
  Wagon wagon() const;
  // The scene begins at `start`. The Error: the scene has no such sensor.
  Result<FrameSource> source(std::string_view name, std::uint8_t rig_index, HostTime start) const;

 private:
  struct State;
  explicit SimulatedWagon(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace wagonsight
