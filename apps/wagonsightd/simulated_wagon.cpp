#include "simulated_wagon.h"

#include <fmt/format.h>

#include <algorithm>
#include <thread>

#include "linux/clocks.h"
#include "linux/files.h"
#include "simulate/room.h"
#include "simulate/scene.h"
#include "simulate/simulation.h"

namespace wagonsight {
namespace {

constexpr std::size_t kSceneBytesMax = std::size_t{1} << 20U;

// Simulated sensors follow the unit's clock.
class LifePace final : public Pace {
 public:
  bool wait_until(HostTime when, Duration timeout) override {
    const Duration ahead = when - host_now();
    if (ahead > Duration::zero()) std::this_thread::sleep_for(std::min(ahead, timeout));
    return ahead <= timeout;
  }
  Duration behind(HostTime when) const override { return host_now() - when; }
};

LifePace& life_pace() {
  static LifePace pace;
  return pace;
}

}  // namespace

struct SimulatedWagon::State {
  Scene scene;
  std::uint64_t seed = 1;
};

SimulatedWagon::SimulatedWagon(std::unique_ptr<State> state) : state_(std::move(state)) {}
SimulatedWagon::SimulatedWagon(SimulatedWagon&&) noexcept = default;
SimulatedWagon& SimulatedWagon::operator=(SimulatedWagon&&) noexcept = default;
SimulatedWagon::~SimulatedWagon() = default;

Result<SimulatedWagon> SimulatedWagon::open(const std::string& scene_path, std::uint64_t seed) {
  const auto text = read_file(scene_path, kSceneBytesMax);
  if (!text) return tl::unexpected(text.error());
  auto scene = parse_scene(*text, scene_path);
  if (!scene) return tl::unexpected(scene.error());
  return SimulatedWagon(std::make_unique<State>(State{std::move(*scene), seed}));
}

Rig SimulatedWagon::rig() const {
  return rig_of(state_->scene);
}

Wagon SimulatedWagon::wagon() const {
  return wagon_of(state_->scene);
}

Result<FrameSource> SimulatedWagon::source(std::string_view name, std::uint8_t rig_index,
                                           HostTime start) const {
  const auto& sensors = state_->scene.sensors;
  const auto found = std::find_if(sensors.begin(), sensors.end(),
                                  [&](const SceneSensor& s) { return s.name == name; });
  if (found == sensors.end())
    return fail(
        fmt::format("settings: sensor {}: is not in the scene; name one of its sensors", name));
  const auto index = static_cast<std::size_t>(found - sensors.begin());
  FrameSource source;
  source.rig_index.fill(FrameSource::kNone);
  source.rig_index[index] = rig_index;
  source.is_background_work = true;
  source.sensor =
      std::make_unique<SimulatedSensor>(state_->scene, index, state_->seed, life_pace(), start);
  return source;
}

}  // namespace wagonsight
