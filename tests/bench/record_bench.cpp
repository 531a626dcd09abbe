#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "bench/capture_bench.h"
#include "bench/exposure_step.h"
#include "bench/no_sink.h"
#include "depot_recorder.h"
#include "linux/clocks.h"
#include "linux/resources.h"
#include "recording/recording_writer.h"
#include "simulate/room.h"
#include "simulate/simulation.h"

namespace wagonsight::bench {
namespace {

// What one sensor sees in a second or so of the scene, drawn beforehand.
struct DrawnSensor {
  double rate_hz = 0;
  FrameSlot slot;  // of every frame but its bytes and times
  std::vector<std::vector<std::byte>> frames;
};

struct DrawnRig {
  Rig rig;
  std::vector<DrawnSensor> sensors;
  std::size_t slot_bytes = 0;

  double raw_bytes_per_s() const {
    double sum = 0;
    for (const DrawnSensor& sensor : sensors)
      sum += sensor.rate_hz * static_cast<double>(sensor.frames.front().size());
    return sum;
  }
};

Result<std::string> text_of(const std::string& path) {
  std::ifstream file(path);
  if (!file) return fail(fmt::format("{}: cannot be read", path));
  return std::string(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
}

// A camera whose exposure has settled, as a driver has it after a second.
void settle_exposure(SimulatedDevice& device, FrameSlot& slot) {
  constexpr int kImages = 6;
  for (int i = 0; i < kImages && device.stereo() != nullptr; ++i) draw_and_expose(device, slot);
}

Result<DrawnRig> draw(const std::string& scene_path, const std::string& rig_path) {
  constexpr double kFrom_s = 20, kFor_s = 1;  // people walk about by then
  const auto scene_text = text_of(scene_path), rig_text = text_of(rig_path);
  if (!scene_text) return tl::unexpected(scene_text.error());
  if (!rig_text) return tl::unexpected(rig_text.error());
  const auto scene = parse_scene(*scene_text + "\n" + *rig_text, scene_path);
  if (!scene) return tl::unexpected(scene.error());
  DrawnRig drawn;
  drawn.rig = rig_of(*scene);
  for (std::size_t i = 0; i < drawn.rig.sensors.size(); ++i) {
    SimulatedDevice device(*scene, i, 1);
    DrawnSensor& sensor = drawn.sensors.emplace_back();
    sensor.rate_hz = drawn.rig.sensors[i].rate_hz;
    drawn.slot_bytes = std::max(drawn.slot_bytes, device.slot_bytes());
    while (to_seconds(device.upcoming().instant.time_since_epoch()) < kFrom_s) device.skip();
    std::vector<std::byte> memory(device.slot_bytes());
    sensor.slot.bytes = memory;
    settle_exposure(device, sensor.slot);
    const auto count = static_cast<std::size_t>(kFor_s * sensor.rate_hz);
    for (std::size_t frame = 0; frame < count; ++frame) {
      device.next(sensor.slot);
      sensor.frames.push_back(memory);
    }
  }
  return drawn;
}

struct Fed {
  std::uint64_t frames = 0, bytes = 0;
  Duration longest{}, cpu{};
};

// What a sensor's thread does: a frame when it is due, and the recorder sees it.
void feed(DrawnSensor& sensor, std::uint8_t index, HostTime start, Duration length,
          DepotRecorder& recorder, Fed& fed) {
  const Duration cpu_before = thread_cpu_time();
  FrameSlot slot = sensor.slot;
  slot.sensor_index = index;
  for (std::uint32_t number = 0;; ++number) {
    const Duration due = from_seconds(number / sensor.rate_hz);
    if (due >= length) break;
    std::this_thread::sleep_for(start + due - host_now());
    auto& pixels = sensor.frames[number % sensor.frames.size()];
    slot.bytes = pixels;
    slot.sequence = number;
    slot.instant = slot.arrival = host_now();
    recorder.offer(slot);
    fed.longest = std::max(fed.longest, host_now() - slot.arrival);
    ++fed.frames;
    fed.bytes += pixels.size();
  }
  fed.cpu = thread_cpu_time() - cpu_before;
}

void wait_until_off(const DepotRecorder& recorder) {
  while (recorder.status().state != RecordingState::kOff)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
}

// Packs what was drawn, of one kind of sensors or all, in the order in which it comes.
Result<void> pack(const DrawnRig& drawn, std::optional<SensorKind> kind, int level) {
  NoSink sink;
  RecordingOptions options;
  options.mcap.zstd_level = level;
  auto writer = RecordingWriter::create(sink, drawn.rig, options);
  if (!writer) return tl::unexpected(writer.error());
  const std::size_t begin = sink.bytes();
  std::size_t raw = 0;
  const Duration before = thread_cpu_time();
  constexpr std::size_t kSteps = 30;
  for (std::size_t step = 0; step < kSteps; ++step)
    for (std::size_t i = 0; i < drawn.sensors.size(); ++i) {
      const DrawnSensor& sensor = drawn.sensors[i];
      if (kind && drawn.rig.sensors[i].kind != *kind) continue;
      const std::size_t frame = step * sensor.frames.size() / kSteps;
      if (step > 0 && frame == (step - 1) * sensor.frames.size() / kSteps) continue;
      FrameSlot slot = sensor.slot;
      slot.sensor_index = static_cast<std::uint8_t>(i);
      auto pixels = sensor.frames[frame];
      slot.bytes = pixels;
      slot.instant = slot.arrival = HostTime(from_seconds(static_cast<double>(step) / kSteps));
      if (auto done = (*writer)->write(slot); !done) return done;
      raw += pixels.size();
    }
  if (auto done = (*writer)->flush(); !done) return done;
  const double cpu_s = to_seconds(thread_cpu_time() - before);
  const auto written = static_cast<double>(sink.bytes() - begin);
  fmt::print("| {} | {} | {:.1f} | {:.1f} | {:.2f} | {:.2f} s |\n",
             !kind                          ? "all"
             : *kind == SensorKind::kKinect ? "Kinects"
                                            : "stereo cameras",
             level, static_cast<double>(raw) * 1e-6, written * 1e-6,
             static_cast<double>(raw) / written, cpu_s);
  return {};
}

}  // namespace

Result<void> run_record(const RecordOptions& options) {
  auto drawn = draw(options.scene, options.rig);
  if (!drawn) return tl::unexpected(drawn.error());
  DepotOptions depot;
  depot.folder = options.folder;
  depot.made_by = "wagonsight-capture-bench";
  depot.memory_bytes = options.memory_mb << 20U;
  DepotRecorder recorder(drawn->rig, drawn->slot_bytes, depot);
  const Duration length = from_seconds(options.seconds);
  constexpr Duration kBehind = std::chrono::seconds(60);  // it is stopped before
  if (auto started = recorder.start(length + kBehind); !started) return started;
  const Duration cpu_before = process_cpu_time();
  const HostTime start = host_now() + std::chrono::milliseconds(200);
  std::vector<Fed> fed(drawn->sensors.size());
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < fed.size(); ++i)
    threads.emplace_back([&, i] {
      feed(drawn->sensors[i], static_cast<std::uint8_t>(i), start, length, recorder, fed[i]);
    });
  for (std::thread& thread : threads) thread.join();
  recorder.stop();
  wait_until_off(recorder);
  Duration cpu = process_cpu_time() - cpu_before, longest{};
  std::uint64_t frames = 0, bytes = 0;
  for (const Fed& one : fed) {
    cpu -= one.cpu;
    longest = std::max(longest, one.longest);
    frames += one.frames;
    bytes += one.bytes;
  }
  const RecordingStatus status = recorder.status();
  const double seconds = options.seconds, raw = static_cast<double>(bytes) * 1e-6,
               disk = static_cast<double>(status.bytes) * 1e-6;
  fmt::print("{} sensors, {:.0f} s: {:.1f} MB/s raw, {:.1f} MB/s on the disk, {:.2f} to 1\n",
             fed.size(), seconds, raw / seconds, disk / seconds, raw / disk);
  fmt::print(
      "{} of {} frames written, {} dropped; the recorder took {:.2f} of a core, the longest "
      "offer() {:.1f} ms\n",
      status.frames, frames, status.dropped, to_seconds(cpu) / seconds, to_milliseconds(longest));
  return {};
}

Result<void> run_compress(const CompressOptions& options) {
  auto drawn = draw(options.scene, options.rig);
  if (!drawn) return tl::unexpected(drawn.error());
  fmt::print("One second of {} sensors, {:.1f} MB\n", drawn->sensors.size(),
             drawn->raw_bytes_per_s() * 1e-6);
  fmt::print(
      "| frames of | level | raw MB | packed MB | ratio | processor "
      "|\n|---|---|---|---|---|---|\n");
  for (const auto kind : {SensorKind::kKinect, SensorKind::kStereo})
    for (const int level : {3, 1, -1, -3, -7, -20})
      if (auto done = pack(*drawn, kind, level); !done) return done;
  return {};
}

}  // namespace wagonsight::bench
