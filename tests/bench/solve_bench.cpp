// What a calibration costs: ten cameras, forty board poses, 54 corners, from the corners to the
// solution with its covariances.
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include "support/synthetic_rig.h"

namespace wagonsight {
namespace {

// `start_values`: intrinsics are refined from stated values; without, Zhang's method begins.
void solve_rig(benchmark::State& state, bool start_values, bool hold_out) {
  const auto rig = synthetic::make(1, {.noise_px = 0.25,
                                       .hidden_share = 0,
                                       .poses = 40,
                                       .kinects = 10,
                                       .stereos = 0,
                                       .fix_kinects = false});
  std::vector<SensorSpec> sensors = rig.sensors;
  if (start_values)
    for (std::size_t i = 0; i < sensors.size(); ++i) sensors[i].start = rig.cameras[i];
  std::size_t corners = 0;
  for (const View& view : rig.observations.views) corners += view.corners.size();
  for (auto _ : state) {
    const auto solution = solve(rig.observations, sensors, {.hold_out = hold_out});
    if (!solution) state.SkipWithError(solution.error().message.c_str());
    benchmark::DoNotOptimize(solution);
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  state.counters["corners"] = static_cast<double>(corners);
  state.counters["resident_MB"] = static_cast<double>(usage.ru_maxrss) / 1024;
}

BENCHMARK_CAPTURE(solve_rig, start, true, false)
    ->Name("solve/wagonsight/ten_cameras")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(solve_rig, held_out, true, true)
    ->Name("solve/wagonsight/ten_cameras_with_held_out")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(solve_rig, nothing, false, true)
    ->Name("solve/wagonsight/ten_cameras_without_start_values")
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace wagonsight
