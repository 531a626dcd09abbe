#include "iidc/iidc_sensor.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <thread>

#include "capture/recovery.h"
#include "iidc/bus_clock.h"
#include "iidc/iidc_device.h"
#include "linux/clocks.h"
#include "linux/sealed_heap.h"

namespace wagonsight {
namespace {

constexpr Duration kCycle = std::chrono::microseconds(125);
constexpr Duration kCyclesToFlush = std::chrono::microseconds(500);
constexpr Duration kReadClocksEvery = std::chrono::milliseconds(50);

constexpr auto kSilent =
    "the stereo camera sends no images; it is being brought back; if that lasts, check its trigger";
constexpr auto kMuteAtExposure =
    "the stereo camera does not take its exposure; it is being brought back";

std::uint32_t counter_in(std::span<const std::uint16_t> pixels, int shift) {
  return std::uint32_t{pixels[0]} << (16 + shift) | std::uint32_t{pixels[1]} << shift;
}

}  // namespace

struct IidcSensor::State final : IsoListener {
  explicit State(IidcOptions wanted) : options(std::move(wanted)), device(*this) {}

  void packet(const IsoPacket& packet) override;
  IidcDevice::Cure next_cure() const;
  void try_to_open();
  void stream(HostTime until);
  Duration until_flush(HostTime now) const;
  void read_clocks(HostTime now);
  void apply_exposure();
  void end_stream(const char* why);

  void begin_image(const IsoPacket& packet);
  void complete_image();
  void lose_image();
  void count_missing(std::uint32_t number, std::uint64_t ticks);
  Exposure exposure_at(HostTime first_packet) const;
  bool stamp(FrameSlot& slot, bool is_damaged);

  IidcOptions options;
  Recovery recovery;
  const char* trouble = nullptr;
  Counters counters;
  Cures cures;
  bool was_silent = false;
  std::atomic<std::uint64_t> wanted_exposure{0};  // two floats; 0: none
  Exposure previous_exposure{};
  HostTime exposure_changed{};

  IidcDevice device;
  PairAssembly assembly;
  BusClock clock;
  HostTime clocks_read{};
  FrameSlot* slot = nullptr;  // that is being filled
  std::uint64_t first_ticks = 0;
  bool is_flushed = false;
  bool has_last = false;  // a good image since it was opened
  std::uint32_t last_number = 0;
  std::uint64_t last_ticks = 0;
  std::uint64_t period_ticks = 0;  // the shortest seen
  std::uint64_t lost_since_last = 0;
  std::uint32_t sequence = 0;

  FramePool* pool = nullptr;  // while poll() runs
  SpscRing<FrameSlot*>* frames = nullptr;
  bool has_news = false;
};

IidcSensor::IidcSensor(IidcOptions options) : state_(std::make_unique<State>(std::move(options))) {}
IidcSensor::~IidcSensor() = default;

std::string_view IidcSensor::name() const {
  return state_->options.name;
}
Sensor::Counters IidcSensor::counters() const {
  return state_->counters;
}
std::string_view IidcSensor::trouble() const {
  const char* text = state_->trouble;
  return text == nullptr ? std::string_view{} : std::string_view(text);
}
double IidcSensor::drift_ppm() const {
  return state_->clock.drift_ppm();
}
double IidcSensor::rate_hz_planned() const {
  return state_->device.plan().rate_hz;
}
IidcSensor::Cures IidcSensor::cures() const {
  return state_->cures;
}
void IidcSensor::set_exposure(const Exposure& exposure) {
  state_->wanted_exposure.store(std::bit_cast<std::uint64_t>(exposure), std::memory_order_relaxed);
}

bool IidcSensor::poll(Duration timeout, FramePool& pool, SpscRing<FrameSlot*>& frames) {
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

// ---- open and watch

IidcDevice::Cure IidcSensor::State::next_cure() const {
  if (was_silent && recovery.failures() <= 1) return IidcDevice::Cure::kInitialise;
  if (recovery.failures() == 0) return IidcDevice::Cure::kNone;
  return device.is_mute() || recovery.failures() % 2 == 0 ? IidcDevice::Cure::kBusReset
                                                          : IidcDevice::Cure::kInitialise;
}

void IidcSensor::State::try_to_open() {
  const IidcDevice::Cure cure = next_cure();
  was_silent = false;
  const char* const opened = device.open({parse_guid(options.device), options.width, options.height,
                                          options.rate_hz_max, options.trigger},
                                         cure);
  if (device.is_plugged()) {
    cures.initialised += cure == IidcDevice::Cure::kInitialise ? 1U : 0U;
    cures.bus_resets += cure == IidcDevice::Cure::kBusReset ? 1U : 0U;
  }
  const HostTime now = host_now();
  if (opened != nullptr) {
    trouble = opened;
    if (device.is_plugged())
      recovery.failed(now);
    else
      recovery.not_there(now);
    return;
  }
  // What was wrong is so until images flow.
  if (trouble == nullptr) trouble = device.remark();
  recovery.opened(now);
  assembly = PairAssembly(device.shape());
  clock = BusClock();  // it may hang on another bus now
  has_last = is_flushed = false;
  lost_since_last = period_ticks = 0;
  previous_exposure = device.exposure();
  exposure_changed = now;
  wanted_exposure.store(0, std::memory_order_relaxed);
  read_clocks(now);
}

void IidcSensor::State::stream(HostTime until) {
  has_news = false;
  const char* ended = nullptr;
  HostTime now = host_now();
  while (ended == nullptr && !has_news && now < until) {
    if (now - clocks_read > kReadClocksEvery) read_clocks(now);
    const Duration flush_in = until_flush(now);
    if (flush_in <= Duration::zero()) {
      is_flushed = true;
      ended = device.flush();
    } else {
      ended = device.wait(std::min(until - now, flush_in));
    }
    now = host_now();
  }
  if (ended == nullptr && has_news) apply_exposure();
  if (ended != nullptr) {
    end_stream(ended);
    recovery.ended(host_now());
  } else if (!recovery.is_closed() && recovery.is_silent(now)) {
    end_stream(kSilent);
    was_silent = true;
  }
}

// An image's last packets would wait for the next image's first ones to be told with them. What is
// not complete by then has lost packets; the next image's begin, or silence, ends it.
Duration IidcSensor::State::until_flush(HostTime now) const {
  if (!assembly.is_open() || is_flushed) return Duration::max();
  const HostTime last = clock.to_host(first_ticks) + device.shape().packets * kCycle;
  return std::max(last + kCyclesToFlush - now, Duration::zero());
}

void IidcSensor::State::read_clocks(HostTime now) {
  const IsoReceiver::Clocks clocks = device.read_clocks();
  if (clocks.are_known) clock.observe(clocks.timer, clocks.host);
  clocks_read = now;
}

void IidcSensor::State::apply_exposure() {
  const std::uint64_t wanted = wanted_exposure.exchange(0, std::memory_order_relaxed);
  if (wanted == 0) return;
  const Exposure before = device.exposure();
  if (!device.set_exposure(std::bit_cast<Exposure>(wanted))) {
    end_stream(kMuteAtExposure);
    recovery.failed(host_now());
    return;
  }
  if (device.exposure().shutter_us == before.shutter_us &&
      device.exposure().gain_db == before.gain_db)
    return;
  previous_exposure = before;
  exposure_changed = host_now();
}

void IidcSensor::State::end_stream(const char* why) {
  {
    const HeapExemption exempt;
    device.close(false);
  }
  if (slot != nullptr) pool->release(slot);
  slot = nullptr;
  trouble = why;
  ++counters.resets;
}

// ---- images

void IidcSensor::State::packet(const IsoPacket& packet) {
  // Until an image begins there is nothing to write to; a begin is known before its pixels go.
  const bool may_begin = packet.begins_image && packet.length == device.shape().packet_bytes;
  if (may_begin) begin_image(packet);
  const std::size_t pixels = static_cast<std::size_t>(device.shape().width) *
                             static_cast<std::size_t>(device.shape().height) * 2;
  const PairAssembly::Step step = assembly.add(
      packet, slot == nullptr
                  ? std::span<std::uint16_t>{}
                  : std::span(reinterpret_cast<std::uint16_t*>(slot->bytes.data()), pixels));
  if (step.lost_one && !step.begins) lose_image();
  if (step.completes) complete_image();
}

void IidcSensor::State::begin_image(const IsoPacket& packet) {
  if (assembly.ends_badly()) lose_image();
  first_ticks = clock.ticks_of(packet.stamp);
  is_flushed = false;
  if (slot == nullptr) slot = pool->acquire();
  const std::size_t bytes = static_cast<std::size_t>(device.shape().width) *
                            static_cast<std::size_t>(device.shape().height) * 4;
  if (slot != nullptr && slot->bytes.size() >= bytes) return;
  pool->release(slot);
  slot = nullptr;
}

// The settings that an image was taken with: a change does not reach one that has begun.
Exposure IidcSensor::State::exposure_at(HostTime first_packet) const {
  const auto shutter = from_seconds(static_cast<double>(previous_exposure.shutter_us) * 1e-6);
  return first_packet - options.readout - shutter < exposure_changed ? previous_exposure
                                                                     : device.exposure();
}

bool IidcSensor::State::stamp(FrameSlot& to, bool is_damaged) {
  const HostTime first_packet = clock.to_host(first_ticks);
  to.sensor_index = options.sensor_index;
  to.sequence = sequence++;
  to.device_ticks = first_ticks;
  to.arrival = host_now();
  to.exposure = exposure_at(first_packet);
  to.instant = first_packet - options.readout -
               from_seconds(static_cast<double>(to.exposure.shutter_us) * 0.5e-6);
  to.damaged = is_damaged;
  to.format = PixelFormat::kGray16;
  to.width = options.width;
  to.height = options.height;
  return frames->try_push(&to);
}

void IidcSensor::State::complete_image() {
  has_news = true;
  if (recovery.frame(host_now())) {
    trouble = device.remark();
    ++cures.reopened;
  }
  std::uint32_t number = 0;
  if (slot != nullptr && device.counts_images()) {
    const std::span pixels(reinterpret_cast<std::uint16_t*>(slot->bytes.data()), 3);
    number = counter_in(pixels, device.shape().shift);
    pixels[0] = pixels[1] = pixels[2];  // of which nothing else is known
  }
  if (slot != nullptr || !device.counts_images()) count_missing(number, first_ticks);
  if (slot != nullptr && stamp(*slot, false)) {
    ++counters.frames;
  } else {
    ++counters.dropped;
    // The camera's counter will say that one is missing.
    if (slot == nullptr && device.counts_images()) ++lost_since_last;
    pool->release(slot);
  }
  slot = nullptr;
}

void IidcSensor::State::lose_image() {
  has_news = true;
  (void)recovery.frame(host_now());
  ++counters.damaged;
  ++lost_since_last;
  if (slot == nullptr) return;
  std::fill(slot->bytes.begin(), slot->bytes.end(), std::byte{0});
  if (!stamp(*slot, true)) pool->release(slot);
  slot = nullptr;
}

// Images between two good ones that nothing came of, or of whose parts more than one was made.
void IidcSensor::State::count_missing(std::uint32_t number, std::uint64_t ticks) {
  if (has_last) {
    std::int64_t passed = 0;
    if (device.counts_images()) {
      passed = std::int64_t{number - last_number} - 1;
    } else if (options.trigger == IidcTrigger::kFree) {
      const std::uint64_t since = ticks - last_ticks;
      period_ticks = period_ticks == 0 ? since : std::min(period_ticks, since);
      passed = std::llround(static_cast<double>(since) / static_cast<double>(period_ticks)) - 1;
    }
    constexpr std::int64_t kPlausible = 1000;  // a counter that began anew tells nothing
    const std::int64_t untold = passed - static_cast<std::int64_t>(lost_since_last);
    if (untold > 0 && passed < kPlausible) counters.damaged += static_cast<std::uint64_t>(untold);
  }
  has_last = true;
  last_number = number;
  last_ticks = ticks;
  lost_since_last = 0;
}

}  // namespace wagonsight
