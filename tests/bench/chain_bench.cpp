#include <benchmark/benchmark.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <string>
#include <vector>

#include "bench/benchmarks.h"
#include "bench/euclidean_clusters.h"
#include "bench/heap_count.h"
#include "bench/scenes.h"
#include "foreground/extractor.h"

namespace wagonsight::bench {
namespace {

// What runs: the rest is compiled for the baseline of its processor family (x86-64: SSE2).
const char* isa() {
  return has_avx2() ? "baseline, mask AVX2" : "baseline";
}

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

// One frame. A function of its own, so that callgrind can count its instructions alone.
[[gnu::noinline]] std::size_t wagonsight_chain_frame(ForegroundExtractor& extractor,
                                                     EuclideanClusters& clusters, DepthImage image,
                                                     HostTime now, Foreground& foreground) {
  extractor.extract(image, now, foreground);
  return clusters.count(foreground.points.span(), kClusterPointsMin);
}

// From the raw depth image to clusters, with everything that a frame costs in service: the mask,
// the background's upkeep, blobs, voxel grid, clusters.
void chain(benchmark::State& state, const BenchScene& scene) {
  const auto extractor = learned_extractor(scene);
  Foreground foreground(scene.rays.size());
  EuclideanClusters clusters(scene.wagon.inside, kCluster_m, kSensorPointsMax);
  HostTime now = HostTime{} + std::chrono::hours(1);
  std::size_t frame = 0, pixels = 0, changed = 0, points = 0, found = 0, frames = 0;
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
    found += wagonsight_chain_frame(*extractor, clusters, scene.view(scene.frames[frame]), now,
                                    foreground);
    calls += heap_calls() - heap_before;
    frame = (frame + 1) % scene.frames.size();
    points += foreground.points.size();
    changed += extractor->changed_pixels();
    for (const Blob& blob : foreground.blobs) pixels += blob.pixels;
    ++frames;
  }
  const auto per_frame = [&](auto sum) {
    return static_cast<double>(sum) / static_cast<double>(frames);
  };
  state.counters["heap_calls"] = per_frame(calls);
  state.counters["foreground_share"] = per_frame(pixels) / static_cast<double>(scene.rays.size());
  state.counters["changed_share"] = per_frame(changed) / static_cast<double>(scene.rays.size());
  state.counters["points"] = per_frame(points);
  state.counters["clusters"] = per_frame(found);
  state.SetLabel(isa());
}

// What the kept blobs consist of, as shares of the image: pixels that are foreground by the strict
// definition, pixels that see beyond all background (unknown), and the rest, which the background
// of the moment calls background by now.
void tell_blob_shares(benchmark::State& state, const BenchScene& scene) {
  const auto extractor = learned_extractor(scene);
  Foreground foreground(scene.rays.size());
  std::vector<std::uint64_t> sure(foreground.mask.size()), unknown(foreground.mask.size());
  HostTime now = HostTime{} + std::chrono::hours(1);
  std::size_t kept = 0, kept_sure = 0, kept_unknown = 0;
  for (const Frame& frame : scene.frames) {
    extractor->extract(scene.view(frame), now += std::chrono::microseconds(33'333), foreground);
    extractor->background().thresholds().classify(
        extractor->view(), extractor->background().leaves(), scene.view(frame), sure, unknown);
    for (std::size_t word = 0; word < sure.size(); ++word) {
      const std::uint64_t mask = foreground.mask[word];
      kept += static_cast<std::size_t>(std::popcount(mask));
      kept_sure += static_cast<std::size_t>(std::popcount(mask & sure[word]));
      kept_unknown += static_cast<std::size_t>(std::popcount(mask & unknown[word] & ~sure[word]));
    }
  }
  const auto share = [&](std::size_t pixels) {
    return static_cast<double>(pixels) /
           static_cast<double>(scene.frames.size() * scene.rays.size());
  };
  state.counters["blobs_share"] = share(kept);
  state.counters["blobs_sure"] = share(kept_sure);
  state.counters["blobs_unknown"] = share(kept_unknown);
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
  tell_blob_shares(state, scene);
  if (frames > 0) {
    state.counters["foreground_share"] =
        static_cast<double>(pixels) / static_cast<double>(frames * scene.rays.size());
  }
  state.SetLabel(isa());
}

// What the first ten seconds of a sensor cost, frame by frame, with a background that is drawn up
// in `first_background_s`.
void first_frames(benchmark::State& state, const BenchScene& scene, double first_background_s) {
  ForegroundOptions options;
  options.leaf_m = kLeaf_m;
  options.voxel_m = kVoxel_m;
  options.first_background_s = first_background_s;
  Foreground foreground(scene.rays.size());
  std::vector<double> costs_ms;
  for (auto _ : state) {
    auto extractor = *ForegroundExtractor::create(scene.sensor, scene.rays, scene.wagon, options);
    HostTime now{};
    for (std::size_t i = 0; i < 300; ++i, now += std::chrono::microseconds(33'333)) {
      const std::size_t frame = i % (scene.background.size() + scene.frames.size());
      const auto& image = frame < scene.background.size()
                              ? scene.background[frame]
                              : scene.frames[frame - scene.background.size()];
      const auto begin = std::chrono::steady_clock::now();
      extractor->extract(scene.view(image), now, foreground);
      const std::chrono::duration<double, std::milli> cost =
          std::chrono::steady_clock::now() - begin;
      costs_ms.push_back(cost.count());
    }
  }
  std::sort(costs_ms.begin(), costs_ms.end());
  const auto at = [&](double share) {
    return costs_ms[static_cast<std::size_t>(share * static_cast<double>(costs_ms.size() - 1))];
  };
  state.counters["p50_ms"] = at(0.5);
  state.counters["p99_ms"] = at(0.99);
  state.counters["max_ms"] = costs_ms.back();
}

void first_frames_spread(benchmark::State& state, const BenchScene& scene) {
  first_frames(state, scene, 1.0);
}

void first_frames_at_once(benchmark::State& state, const BenchScene& scene) {
  first_frames(state, scene, 0);
}

}  // namespace

void register_chain() {
  register_on_every_scene("chain/wagonsight/", chain);
  register_on_every_scene("mask/wagonsight/", mask);
  register_on_every_scene("first/wagonsight/", first_frames_spread);
  register_on_every_scene("first/wagonsight_at_once/", first_frames_at_once);
}

}  // namespace wagonsight::bench
