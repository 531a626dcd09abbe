#include <benchmark/benchmark.h>

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "bench/benchmarks.h"
#include "bench/heap_count.h"
#include "bench/no_sink.h"
#include "bench/scenes.h"
#include "foreground/extractor.h"
#include "fusion/fused_cloud.h"
#include "recording/recording_writer.h"

namespace wagonsight::bench {
namespace {

constexpr std::size_t kViews = 4;

// A rig of four such sensors.
Rig rig_of(const BenchScene& scene) {
  Rig rig;
  for (std::size_t i = 0; i < kViews; ++i) {
    RigSensor sensor = scene.sensor;
    sensor.name = Name("k" + std::to_string(i));
    rig.sensors.push_back(sensor);
  }
  return rig;
}

// Four frames after each other as what four sensors see at one instant: clouds that overlap, as in
// the middle of a wagon.
void fuse(benchmark::State& state, const BenchScene& scene) {
  ForegroundOptions options;
  options.leaf_m = kLeaf_m;
  options.voxel_m = kVoxel_m;
  auto extractor = *ForegroundExtractor::create(scene.sensor, scene.rays, scene.wagon, options);
  HostTime now{};
  for (const Frame& frame : scene.background)
    extractor->learn(scene.view(frame), now += std::chrono::milliseconds(200));
  extractor->finish_learning();
  std::vector<std::unique_ptr<Foreground>> foregrounds;
  std::array<ForegroundView, kViews> views;
  for (std::size_t i = 0; i < kViews; ++i) {
    foregrounds.push_back(std::make_unique<Foreground>(scene.rays.size()));
    extractor->extract(scene.view(scene.frames[scene.frames.size() / 2 + i]),
                       now += std::chrono::milliseconds(33), *foregrounds[i]);
    views[i].foreground = foregrounds[i].get();
  }
  Fusion fusion(rig_of(scene), kVoxel_m);
  std::size_t points = 0, contributions = 0;
  const long heap_before = heap_calls();
  for (auto _ : state) {
    const FusedCloud& cloud = fusion.fuse(views, {});
    points = cloud.points.size();
    contributions = cloud.contributions.size();
  }
  state.counters["heap_calls"] =
      static_cast<double>(heap_calls() - heap_before) / static_cast<double>(state.iterations());
  state.counters["points"] = static_cast<double>(points);
  state.counters["contributions"] = static_cast<double>(contributions);
}

// A depth image into a recording: CDR, chunks, zstd, checksums.
void record(benchmark::State& state, const BenchScene& scene) {
  NoSink sink;
  auto writer = *RecordingWriter::create(sink, rig_of(scene), {});
  std::vector<Frame> frames = scene.frames;
  FrameSlot slot;
  slot.width = scene.sensor.camera.width;
  slot.height = scene.sensor.camera.height;
  std::size_t next = 0;
  const std::size_t bytes_before = sink.bytes();
  for (auto _ : state) {
    slot.bytes = std::as_writable_bytes(std::span(frames[next]));
    slot.instant = slot.arrival += std::chrono::milliseconds(33);
    if (!writer->write(slot)) state.SkipWithError("the recording was refused");
    next = (next + 1) % frames.size();
  }
  const double raw = static_cast<double>(scene.rays.size()) * 2;
  const double written =
      static_cast<double>(sink.bytes() - bytes_before) / static_cast<double>(state.iterations());
  state.counters["compression"] = raw / written;
}

}  // namespace

void register_fuse_and_record() {
  register_on_every_scene("fuse/wagonsight/", fuse);
  register_on_every_scene("record/wagonsight/", record);
}

}  // namespace wagonsight::bench
