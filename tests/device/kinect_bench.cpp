#include "kinect_bench.h"

#include <algorithm>
#include <set>

namespace wagonsight::device {
namespace {

constexpr Nanoseconds kLook = 5'000'000;  // how often frames are taken

std::string serial_of(std::size_t unit) {
  return "A0033333333" + std::to_string(unit) + "A";
}

}  // namespace

KinectBench::KinectBench(std::size_t count, const Change& change, Picture picture)
    : picture_(std::move(picture)),
      pool_(4 * count + 4, static_cast<std::size_t>(KinectUnit::kPixels) * 2),
      logs_(count),
      raw_(KinectUnit::kPixels),
      tables_(count, std::vector<std::uint16_t>(2048)) {
  if (!picture_)
    picture_ = [](std::size_t unit, std::uint32_t number, std::span<std::uint16_t> raw) {
      paint_test_pattern(static_cast<unsigned>(unit), number, raw);
    };
  for (std::size_t i = 0; i < count; ++i) {
    KinectUnit::Options options;
    options.serial = serial_of(i);
    options.feed = [this, i](std::uint32_t number, Nanoseconds /*light*/,
                             std::span<std::uint16_t> raw) { picture_(i, number, raw); };
    options.drift_ppm = 20.0 * static_cast<double>(i) - 30.0;
    options.phase = static_cast<Nanoseconds>(i) * 7'300'000;
    options.first_ticks = 0xF0000000U + static_cast<std::uint32_t>(i) * 0x01234567U;
    options.optics.shift = static_cast<std::uint16_t>(198 + i);  // no two are the same
    options.optics.reference_pixel_cm += 0.0003F * static_cast<float>(i);
    if (change) change(i, options);
    units_.push_back(std::make_shared<KinectUnit>(options));
    for (std::uint16_t raw = 0; raw < 2048; ++raw) tables_[i][raw] = units_[i]->millimetres(raw);
    UsbBuses::instance().plug(units_[i], bus_of(i), 1);
  }
  for (std::size_t i = 0; i < count; ++i) {
    sensors_.push_back(std::make_unique<KinectSensor>(
        KinectOptions{"k" + std::to_string(i), serial_of(i), static_cast<std::uint8_t>(i), {}}));
    threads_.push_back(std::make_unique<SensorThread>(*sensors_[i], pool_));
  }
}

KinectBench::~KinectBench() {
  for (auto& thread : threads_) thread->stop();
  taker_ = {};
  take_frames();
  sensors_.clear();
  VirtualTime::instance().forget_script();
  UsbBuses::instance().unplug_everything();
}

void KinectBench::run(double seconds) {
  VirtualTime& time = VirtualTime::instance();
  const Nanoseconds end = time.now() + from_seconds(seconds).count();
  while (time.now() < end) {
    time.sleep_until(std::min(end, time.now() + kLook));
    take_frames();
  }
}

double KinectBench::run_until_frame(std::size_t unit, double seconds_max) {
  VirtualTime& time = VirtualTime::instance();
  const Nanoseconds begin = time.now();
  const std::size_t before = logs_[unit].good.size();
  while (static_cast<double>(time.now() - begin) < seconds_max * 1e9) {
    run(0.005);
    if (logs_[unit].good.size() > before) return static_cast<double>(time.now() - begin) * 1e-9;
  }
  return -1;
}

void KinectBench::script(double in_seconds, std::function<void()> deed) {
  VirtualTime& time = VirtualTime::instance();
  const std::lock_guard hold(time.mutex());
  time.at(time.now() + from_seconds(in_seconds).count(), std::move(deed));
}

void KinectBench::take_frames() {
  for (std::size_t i = 0; i < threads_.size(); ++i) {
    while (FrameSlot* slot = threads_[i]->take()) {
      check(i, *slot);
      if (taker_)
        taker_(slot);
      else
        pool_.release(slot);
    }
  }
}

void KinectBench::check(std::size_t unit, const FrameSlot& slot) {
  Log& log = logs_[unit];
  if (slot.damaged) {
    ++log.damaged;
    return;
  }
  const std::uint32_t number = units_[unit]->frame_of_ticks(slot.device_ticks);
  log.good.push_back({number, slot.instant, slot.arrival});
  {
    const std::lock_guard hold(VirtualTime::instance().mutex());  // as when the unit asks
    picture_(unit, number, raw_);
  }
  const DepthImage depth = slot.depth();
  const auto& table = tables_[unit];
  for (std::size_t i = 0; i < raw_.size(); ++i)
    log.wrong_pixels += depth.pixels[i] == table[raw_[i]] ? 0U : 1U;
}

KinectBench::Balance KinectBench::balance(std::size_t unit) const {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  Balance balance;
  std::set<std::uint32_t> delivered;
  for (const Delivery& delivery : logs_[unit].good)
    balance.repeated += delivered.insert(delivery.number).second ? 0U : 1U;
  if (delivered.empty()) return balance;
  for (const KinectUnit::Sent& sent : units_[unit]->sent()) {
    const bool came = delivered.count(sent.number) != 0;
    balance.delivered_damaged += came && !sent.whole ? 1U : 0U;
    if (sent.number < *delivered.begin() || sent.number > *delivered.rbegin()) continue;
    balance.whole += sent.whole ? 1U : 0U;
    balance.missing += sent.whole && !came ? 1U : 0U;
  }
  return balance;
}

}  // namespace wagonsight::device
