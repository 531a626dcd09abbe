#include <benchmark/benchmark.h>

#include <bit>
#include <string>
#include <vector>

#include "bench/benchmarks.h"
#include "bench/euclidean_clusters.h"
#include "bench/heap_count.h"
#include "bench/scenes.h"
#include "foreground/extractor.h"

namespace wagonsight::bench {
namespace {

std::unique_ptr<ForegroundExtractor> learned_extractor(const BenchScene& scene) {
  ForegroundOptions options;
  options.leaf_m = kLeaf_m;
  options.voxel_m = kVoxel_m;
  auto extractor = *ForegroundExtractor::create(scene.sensor, scene.rays, scene.wagon, options);
  HostTime now{};
  for (const Frame& frame : scene.background) {
    now += std::chrono::milliseconds(200);
    extractor->learn(scene.view(frame), now);
  }
  extractor->finish_learning();
  return extractor;
}

// From the raw depth image to clusters, with everything that a frame costs in service: the mask,
// the background's upkeep, blobs, voxel grid, clusters.
void chain(benchmark::State& state, const BenchScene& scene) {
  const auto extractor = learned_extractor(scene);
  Foreground foreground(scene.rays.size());
  EuclideanClusters clusters(scene.wagon.inside, kCluster_m, kSensorPointsMax);
  HostTime now = HostTime{} + std::chrono::hours(1);
  std::size_t frame = 0, pixels = 0, points = 0, found = 0, frames = 0;
  const std::vector<std::byte> background = extractor->save_background();
  long calls = 0;
  for (auto _ : state) {
    if (frame == 0) {  // a recording is no loop: time would teach what never was
      state.PauseTiming();
      (void)extractor->load_background(background).has_value();
      state.ResumeTiming();
    }
    const long heap_before = heap_calls();
    now += std::chrono::microseconds(33'333);
    extractor->extract(scene.view(scene.frames[frame]), now, foreground);
    found += clusters.count(foreground.points.span(), kClusterPointsMin);
    calls += heap_calls() - heap_before;
    frame = (frame + 1) % scene.frames.size();
    points += foreground.points.size();
    for (const Blob& blob : foreground.blobs) pixels += blob.pixels;
    ++frames;
  }
  const auto per_frame = [&](auto sum) {
    return static_cast<double>(sum) / static_cast<double>(frames);
  };
  state.counters["heap_calls"] = per_frame(calls);
  state.counters["foreground_share"] = per_frame(pixels) / static_cast<double>(scene.rays.size());
  state.counters["points"] = per_frame(points);
  state.counters["clusters"] = per_frame(found);
}

// From the raw depth image to the noise-aware mask.
void mask(benchmark::State& state, const BenchScene& scene) {
  const auto extractor = learned_extractor(scene);
  std::vector<std::uint64_t> foreground((scene.rays.size() + 63) / 64), unknown(foreground.size());
  std::size_t frame = 0, pixels = 0, frames = 0;
  const long heap_before = heap_calls();
  for (auto _ : state) {
    extractor->background().thresholds().classify(
        extractor->view(), extractor->background().leaves(), scene.view(scene.frames[frame]),
        foreground, unknown);
    benchmark::DoNotOptimize(foreground.data());
    benchmark::ClobberMemory();
    frame = (frame + 1) % scene.frames.size();
    if (frame == 0) {
      for (const std::uint64_t word : foreground) {
        pixels += static_cast<std::size_t>(std::popcount(word));
      }
      ++frames;
    }
  }
  state.counters["heap_calls"] =
      static_cast<double>(heap_calls() - heap_before) / static_cast<double>(state.iterations());
  if (frames > 0) {
    state.counters["foreground_share"] =
        static_cast<double>(pixels) / static_cast<double>(frames * scene.rays.size());
  }
  state.SetLabel(has_avx2() ? "AVX2" : "baseline");
}

}  // namespace

void register_chain() {
  for (const std::string& name : scene_names()) {
    const auto add = [&](const std::string& work,
                         void (*run)(benchmark::State&, const BenchScene&)) {
      benchmark::RegisterBenchmark((work + name).c_str(), [name, run](benchmark::State& state) {
        run(state, scene_of(name));
      })->Unit(benchmark::kMillisecond);
    };
    add("chain/wagonsight/", chain);
    add("mask/wagonsight/", mask);
  }
}

}  // namespace wagonsight::bench
