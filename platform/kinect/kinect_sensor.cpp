#include "kinect/kinect_sensor.h"

#include <algorithm>
#include <cmath>
#include <thread>

#include "capture/recovery.h"
#include "kinect/depth_assembly.h"
#include "kinect/kinect_device.h"
#include "kinect/usb_places.h"
#include "linux/clocks.h"
#include "linux/sealed_heap.h"

namespace wagonsight {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr Duration kAfterReset = milliseconds(300);  // until it can be opened again
// A device that stays away although it was there: its port may hang.
constexpr Duration kAwayMax = seconds(10);
constexpr double kFramesPerSecond = 30.0;
constexpr double kDriftMax_ppm = 500;

constexpr auto kSilent = "the Kinect sends nothing; it is being brought back";

}  // namespace

struct KinectSensor::State final : KinectListener {
  explicit State(KinectOptions wanted) : options(std::move(wanted)), device(*this) {}

  void packet(int number, std::uint32_t ticks, std::span<const std::byte> payload) override {
    assembly.add(number, payload);
    // Each packet tells the time, not only the last of its frame: there are two hundred times as
    // many, in fifteen transfers, and a lost one spoils none of the others.
    clock.observe(unwrapper.unwrap(ticks), host_now());
  }
  void frame_end(std::uint32_t ticks) override;

  void try_to_open();
  void climb();
  void wake_port();
  void end_stream(const char* why);
  void stream(HostTime until);
  void count_lost_frames(std::uint64_t ticks, HostTime arrival);
  void push(std::uint64_t ticks, HostTime arrival, HostTime instant, bool is_whole);

  KinectOptions options;
  Recovery recovery;
  HostTime last_seen{};  // plugged in
  const char* trouble = nullptr;
  Counters counters;
  Ladder ladder;

  DepthAssembly assembly;
  KinectDevice device;
  TickUnwrapper unwrapper{32};
  ClockFit clock{{kKinectTicksPerSecond, {}, kDriftMax_ppm}};
  bool has_ticks = false;
  std::uint64_t last_ticks = 0;
  std::uint32_t sequence = 0;

  FramePool* pool = nullptr;  // while poll() runs
  SpscRing<FrameSlot*>* frames = nullptr;
  bool has_news = false;
};

KinectSensor::KinectSensor(KinectOptions options)
    : state_(std::make_unique<State>(std::move(options))) {}
KinectSensor::~KinectSensor() = default;

std::string_view KinectSensor::name() const {
  return state_->options.name;
}
Sensor::Counters KinectSensor::counters() const {
  return state_->counters;
}
std::string_view KinectSensor::trouble() const {
  const char* text = state_->trouble;
  return text == nullptr ? std::string_view{} : std::string_view(text);
}
double KinectSensor::drift_ppm() const {
  return state_->clock.drift_ppm();
}
KinectSensor::Ladder KinectSensor::ladder() const {
  return state_->ladder;
}

bool KinectSensor::poll(Duration timeout, FramePool& pool, SpscRing<FrameSlot*>& frames) {
  State& s = *state_;
  s.pool = &pool;
  s.frames = &frames;
  const HostTime now = host_now();
  if (!s.recovery.is_closed()) {
    s.stream(now + timeout);
  } else if (now < s.recovery.next_attempt()) {
    std::this_thread::sleep_for(std::min(timeout, s.recovery.next_attempt() - now));
  } else {
    const HeapExemption exempt;
    s.try_to_open();
  }
  return true;
}

void KinectSensor::State::try_to_open() {
  if (recovery.failures() > 0) climb();
  const char* const refusal = device.open(options.device);
  const HostTime now = host_now();
  // What was wrong is so until frames come.
  if (refusal != nullptr)
    trouble = refusal;
  else if (trouble == nullptr)
    trouble = device.remark();
  if (refusal == nullptr) {
    recovery.opened(now);
    // Its clock may have begun anew.
    unwrapper = TickUnwrapper(32);
    clock = ClockFit({kKinectTicksPerSecond, options.light_to_arrival, kDriftMax_ppm});
    has_ticks = false;
  } else if (device.is_plugged()) {
    recovery.failed(now);
  } else {
    recovery.not_there(now);
    if (now - last_seen > kAwayMax && !device.place().empty()) wake_port();
  }
  if (device.is_plugged()) last_seen = now;
}

// Before the next attempt to open a device that is there: first a reset, then, every other time,
// its port's power.
void KinectSensor::State::climb() {
  if (recovery.failures() % 2 == 0 && cycle_port_power(device.place())) {
    ++ladder.power_cycles;
  } else if (device.reset(options.device)) {
    ++ladder.bus_resets;
  } else {
    return;
  }
  std::this_thread::sleep_for(kAfterReset);
}

void KinectSensor::State::wake_port() {
  if (cycle_port_power(device.place())) ++ladder.power_cycles;
  last_seen = host_now();
}

void KinectSensor::State::end_stream(const char* why) {
  {
    const HeapExemption exempt;
    device.close();
  }
  trouble = why;
  ++counters.resets;
}

void KinectSensor::State::stream(HostTime until) {
  has_news = false;
  const char* ended = nullptr;
  HostTime now = host_now();
  while (ended == nullptr && !has_news && now < until) {
    const HeapExemption exempt;
    ended = device.process(until - now);
    now = host_now();
  }
  if (ended != nullptr) {
    end_stream(ended);
    recovery.ended(host_now());
  } else if (recovery.is_silent(now)) {
    end_stream(kSilent);
  }
}

void KinectSensor::State::frame_end(std::uint32_t raw_ticks) {
  const HostTime arrival = host_now();
  has_news = true;
  if (recovery.frame(arrival)) {
    trouble = device.remark();
    ++ladder.reopened;
  }
  const std::uint64_t ticks = unwrapper.unwrap(raw_ticks);
  const bool is_whole = assembly.finish();
  count_lost_frames(ticks, arrival);
  // A clock that began anew while the device was opened may not have met a packet yet.
  const HostTime instant =
      clock.has_started() ? clock.to_host(ticks) : clock.observe(ticks, arrival);
  last_ticks = ticks;
  has_ticks = true;
  push(ticks, arrival, instant, is_whole);
}

// Frames of which not even the end came show in the timestamps.
void KinectSensor::State::count_lost_frames(std::uint64_t ticks, HostTime arrival) {
  if (!has_ticks || ticks <= last_ticks) return;
  const double frames_passed =
      static_cast<double>(ticks - last_ticks) / kKinectTicksPerSecond * kFramesPerSecond;
  const double frames_possible = to_seconds(arrival - recovery.opened_at()) * kFramesPerSecond +
                                 1;  // a clock that jumped tells nothing
  const auto lost = std::lround(frames_passed) - 1;
  if (lost > 0 && frames_passed < frames_possible)
    counters.damaged += static_cast<std::uint64_t>(lost);
}

void KinectSensor::State::push(std::uint64_t ticks, HostTime arrival, HostTime instant,
                               bool is_whole) {
  if (!is_whole) ++counters.damaged;
  FrameSlot* slot = pool->acquire();
  if (slot == nullptr) {
    counters.dropped += is_whole ? 1U : 0U;
    return;
  }
  slot->sensor_index = options.sensor_index;
  slot->sequence = sequence++;
  slot->device_ticks = ticks;
  slot->arrival = arrival;
  slot->instant = instant;
  slot->damaged = !is_whole;
  slot->format = PixelFormat::kDepth16;
  slot->width = kKinectWidth;
  slot->height = kKinectHeight;
  const auto pixels = slot->depth_pixels();
  if (is_whole)
    assembly.convert(device.depth_table(), pixels);
  else
    std::fill(pixels.begin(), pixels.end(), std::uint16_t{0});
  if (!frames->try_push(slot)) {
    pool->release(slot);
    counters.dropped += is_whole ? 1U : 0U;
  } else if (is_whole) {
    ++counters.frames;
  }
}

}  // namespace wagonsight
