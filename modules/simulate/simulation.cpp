#include "simulate/simulation.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "simulate/random.h"

namespace wagonsight {
namespace {

// A frame is read out and sent in one frame time; the host's scheduling adds a little.
constexpr double kTransport = 0.036;

}  // namespace

FrameClock::FrameClock(const Scene& scene, std::size_t sensor, std::uint64_t seed)
    : scene_(&scene),
      sensor_(sensor),
      seed_(mixed(seed, 0xC10C, sensor)),
      ticks_at_start_(mixed(seed_, 1) >> 24U & 0xFFFFFFFFU) {}

FrameTiming FrameClock::next() {
  const SceneSensor& sensor = scene_->sensors[sensor_];
  // A clock that is fast by d counts (1 + d) ticks for one and takes its frames earlier.
  const double rate = 1 + sensor.drift_ppm * 1e-6;
  const double phase = std::max(0.0, sensor.phase_s);
  FrameTiming timing;
  timing.sequence = sequence_++;
  const double taken = phase + timing.sequence / (sensor.rate_hz * rate);
  const double stamped = taken + sensor.stamp_late_s;
  timing.device_ticks =
      ticks_at_start_ + static_cast<std::uint64_t>(std::llround(stamped * rate * kTicksPerSecond));
  timing.instant = HostTime(from_seconds(taken));
  timing.stamp = HostTime(from_seconds(stamped));
  const double chance = uniform(mixed(seed_, 2, timing.sequence));
  double delay = kTransport - 0.0004 * std::log(1 - chance);  // mostly prompt, sometimes not
  double loss = sensor.drop_rate;
  const double seconds = time_in(*scene_, taken);
  for (const SceneFault& fault : scene_->faults) {
    if (fault.sensor != static_cast<int>(sensor_)) continue;
    if (seconds < fault.at || seconds >= fault.at + fault.for_s) continue;
    if (fault.kind == FaultKind::kUnplug) loss = 1;
    if (fault.kind == FaultKind::kLate) delay += fault.amount;
    if (fault.kind == FaultKind::kLoss) loss = std::max(loss, fault.amount);
  }
  timing.lost = uniform(mixed(seed_, 3, timing.sequence)) < loss;
  timing.arrival = std::max(timing.instant + from_seconds(delay), timing.stamp);
  // Frames of one sensor do not overtake each other.
  timing.arrival = std::max(timing.arrival, last_arrival_ + std::chrono::microseconds(1));
  if (!timing.lost) last_arrival_ = timing.arrival;
  return timing;
}

SimulatedDevice::SimulatedDevice(const Scene& scene, std::size_t sensor, std::uint64_t seed)
    : sensor_(sensor), world_(scene, seed), clock_(world_.scene(), sensor, seed) {
  if (scene.sensors[sensor].kind == SensorKind::kStereo) {
    stereo_ = std::make_unique<StereoModel>(world_.scene(), sensor, seed);
  } else {
    kinect_ = std::make_unique<KinectModel>(world_.scene(), sensor, seed);
  }
  advance();
}

void SimulatedDevice::advance() {
  // A sensor that never delivers anything is looked for no more than a day ahead.
  constexpr int kFramesAhead = 30 * 86'400;
  for (int i = 0; i < kFramesAhead; ++i) {
    upcoming_ = clock_.next();
    if (!upcoming_.lost) return;
    ++lost_;
  }
}

void SimulatedDevice::skip() {
  advance();
}

void SimulatedDevice::next(FrameSlot& slot) {
  slot.sensor_index = static_cast<std::uint8_t>(sensor_);
  slot.sequence = upcoming_.sequence;
  slot.device_ticks = upcoming_.device_ticks;
  slot.instant = upcoming_.stamp;
  slot.arrival = upcoming_.arrival;
  slot.damaged = false;
  WS_CHECK(slot.bytes.size() >= slot_bytes(), "slot of %zu bytes", slot.bytes.size());
  if (stereo_ != nullptr) {
    slot.format = PixelFormat::kGray16;
    slot.width = stereo_->width();
    slot.height = stereo_->height();
    slot.exposure = exposure_;
    const std::span pair(reinterpret_cast<std::uint16_t*>(slot.bytes.data()),
                         slot_bytes() / sizeof(std::uint16_t));
    stereo_->render(world_, upcoming_.instant, upcoming_.sequence, exposure_, pair);
  } else {
    slot.format = PixelFormat::kDepth16;
    slot.width = kinect_->camera().width;
    slot.height = kinect_->camera().height;
    kinect_->render(world_, upcoming_.instant, upcoming_.sequence, slot.depth_pixels());
  }
  advance();
}

std::size_t SimulatedDevice::slot_bytes() const {
  const int pixels = stereo_ != nullptr ? 2 * stereo_->width() * stereo_->height()
                                        : kinect_->camera().width * kinect_->camera().height;
  return static_cast<std::size_t>(pixels) * sizeof(std::uint16_t);
}

void SimulatedDevice::set_exposure(const Exposure& exposure) {
  if (exposure.shutter_us > 0) exposure_ = exposure;
}

Simulation::Simulation(const Scene& scene, std::uint64_t seed)
    : scene_(scene), world_(scene, seed) {
  for (std::size_t i = 0; i < scene.sensors.size(); ++i)
    devices_.push_back(std::make_unique<SimulatedDevice>(scene, i, seed));
}

const FrameTiming& Simulation::upcoming(std::size_t& sensor) const {
  WS_CHECK(!devices_.empty(), "%s", "a scene without sensors has no frames");
  sensor = 0;
  for (std::size_t i = 1; i < devices_.size(); ++i)
    if (devices_[i]->upcoming().arrival < devices_[sensor]->upcoming().arrival) sensor = i;
  return devices_[sensor]->upcoming();
}

void Simulation::next(FrameSlot& slot) {
  std::size_t sensor = 0;
  (void)upcoming(sensor);
  devices_[sensor]->next(slot);
}

SimulatedSensor::SimulatedSensor(const Scene& scene, std::size_t sensor, std::uint64_t seed,
                                 Pace& pace, HostTime start, Duration end)
    : scene_(scene),
      name_(scene.sensors[sensor].name),
      device_(scene_, sensor, seed),
      pace_(&pace),
      start_(start),
      end_(end) {}

bool SimulatedSensor::poll(Duration timeout, FramePool& pool, SpscRing<FrameSlot*>& frames) {
  const FrameTiming& timing = device_.upcoming();
  const Duration arrival = timing.arrival.time_since_epoch();
  if (arrival > end_) return false;
  if (!pace_->wait_until(start_ + arrival, timeout)) return true;
  constexpr Duration kBehindMax = std::chrono::milliseconds(50);
  const bool behind = pace_->behind(start_ + arrival) > kBehindMax;
  FrameSlot* slot = behind ? nullptr : pool.acquire();
  if (slot == nullptr) {
    device_.skip();
    ++counters_.dropped;
    return true;
  }
  device_.set_exposure(wanted_exposure_.load(std::memory_order_relaxed));
  device_.next(*slot);
  slot->instant = start_ + slot->instant.time_since_epoch();
  slot->arrival = start_ + slot->arrival.time_since_epoch();
  if (frames.try_push(slot)) {
    ++counters_.frames;
  } else {
    pool.release(slot);
    ++counters_.dropped;
  }
  return true;
}

}  // namespace wagonsight
