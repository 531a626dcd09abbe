#pragma once

#include <benchmark/benchmark.h>

#include <string>

#include "bench/scenes.h"

namespace wagonsight::bench {

// Each registers its entries for every scene.
void register_chain();
void register_pcl();
void register_fuse_and_record();

// The same choices for every contestant.
inline constexpr double kLeaf_m = 0.05;
inline constexpr double kVoxel_m = 0.02;
inline constexpr double kCluster_m = 0.06;
inline constexpr unsigned kClusterPointsMin = 100;

// An entry named work + scene for one work on every scene; `more` follows the scene in the call.
template <typename... More>
void register_on_every_scene(const std::string& work,
                             void (*run)(benchmark::State&, const BenchScene&, More...),
                             More... more) {
  for (const std::string& name : scene_names()) {
    benchmark::RegisterBenchmark((work + name).c_str(), [=](benchmark::State& state) {
      run(state, scene_of(name), more...);
    })->Unit(benchmark::kMillisecond);
  }
}

}  // namespace wagonsight::bench
