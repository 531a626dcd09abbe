// Builds without the simulator.
#include "simulated_wagon.h"

namespace wagonsight {

struct SimulatedWagon::State {};

SimulatedWagon::SimulatedWagon(std::unique_ptr<State> state) : state_(std::move(state)) {}
SimulatedWagon::SimulatedWagon(SimulatedWagon&&) noexcept = default;
SimulatedWagon& SimulatedWagon::operator=(SimulatedWagon&&) noexcept = default;
SimulatedWagon::~SimulatedWagon() = default;

Result<SimulatedWagon> SimulatedWagon::open(const std::string&, std::uint64_t) {
  return fail("settings: [demo]: this build has no simulator; use a build with WAGONSIGHT_DEMO");
}
Rig SimulatedWagon::rig() const {
  return {};
}
Wagon SimulatedWagon::wagon() const {
  return {};
}
Result<FrameSource> SimulatedWagon::source(std::string_view, std::uint8_t, HostTime) const {
  return fail("this build has no simulator");
}

}  // namespace wagonsight
