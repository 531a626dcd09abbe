// What a simulated Kinect costs: one frame of 640 x 480 with everything, passengers acting
// included.
#include <benchmark/benchmark.h>

#include <fstream>
#include <sstream>
#include <vector>

#include "simulate/simulation.h"

namespace wagonsight {
namespace {

void simulate_frame(benchmark::State& state, const char* name, double from_s) {
  std::ifstream file(std::string(WAGONSIGHT_SOURCE_DIR "/config/scenes/") + name + ".toml");
  std::stringstream text;
  text << file.rdbuf();
  const auto scene = parse_scene(text.str(), name);
  if (!scene) {
    state.SkipWithError(scene.error().message.c_str());
    return;
  }
  Simulation simulation(*scene, 1);
  for (std::size_t i = 0; i < simulation.sensor_count(); ++i)
    while (to_seconds(simulation.device(i).upcoming().instant.time_since_epoch()) < from_s)
      simulation.device(i).skip();
  std::vector<std::byte> memory(std::size_t{640} * 480 * 2);
  FrameSlot slot;
  slot.bytes = memory;
  for (auto _ : state) simulation.next(slot);
}

BENCHMARK_CAPTURE(simulate_frame, empty, "empty", 1.0)
    ->Name("simulate/wagonsight/empty")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(simulate_frame, walk, "walk", 28.0)
    ->Name("simulate/wagonsight/walk")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(simulate_frame, rush, "rush", 30.0)
    ->Name("simulate/wagonsight/rush")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(simulate_frame, crowd, "crowd", 60.0)
    ->Name("simulate/wagonsight/crowd")
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace wagonsight
