#include "device_bench.h"

#include <algorithm>
#include <set>

namespace wagonsight::device {
namespace {

constexpr Nanoseconds kLook = 5'000'000;  // how often frames are taken

}  // namespace

DeviceBench::~DeviceBench() {
  VirtualTime::instance().forget_script();
}

void DeviceBench::drive(Sensor& sensor) {
  logs_.emplace_back();
  threads_.push_back(std::make_unique<SensorThread>(sensor, pool_));
}

void DeviceBench::stop() {
  for (auto& thread : threads_) thread->stop();
  taker_ = {};
  take_frames();
}

void DeviceBench::run(double seconds) {
  VirtualTime& time = VirtualTime::instance();
  const Nanoseconds end = time.now() + from_seconds(seconds).count();
  while (time.now() < end) {
    time.sleep_until(std::min(end, time.now() + kLook));
    take_frames();
  }
}

double DeviceBench::run_until_frame(std::size_t unit, double seconds_max) {
  const VirtualTime& time = VirtualTime::instance();
  const Nanoseconds begin = time.now();
  const std::size_t before = logs_[unit].good.size();
  while (static_cast<double>(time.now() - begin) < seconds_max * 1e9) {
    run(0.005);
    if (logs_[unit].good.size() > before) return static_cast<double>(time.now() - begin) * 1e-9;
  }
  return -1;
}

void DeviceBench::script(double in_seconds, std::function<void()> deed) {
  VirtualTime& time = VirtualTime::instance();
  const std::lock_guard hold(time.mutex());
  time.at(time.now() + from_seconds(in_seconds).count(), std::move(deed));
}

void DeviceBench::take_frames() {
  for (std::size_t i = 0; i < threads_.size(); ++i) {
    while (FrameSlot* slot = threads_[i]->take()) {
      if (slot->damaged)
        ++logs_[i].damaged;
      else
        check(i, *slot, logs_[i]);
      if (taker_)
        taker_(slot);
      else
        pool_.release(slot);
    }
  }
}

DeviceBench::Balance DeviceBench::balance(std::size_t unit) const {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  Balance balance;
  std::set<std::uint32_t> delivered;
  for (const Delivery& delivery : logs_[unit].good)
    balance.repeated += delivered.insert(delivery.number).second ? 0U : 1U;
  if (delivered.empty()) return balance;
  for (const SentFrame& sent : sent_frames(unit)) {
    const bool came = delivered.count(sent.number) != 0;
    balance.delivered_damaged += came && !sent.whole ? 1U : 0U;
    if (sent.number < *delivered.begin() || sent.number > *delivered.rbegin()) continue;
    balance.whole += sent.whole ? 1U : 0U;
    balance.missing += sent.whole && !came ? 1U : 0U;
  }
  return balance;
}

}  // namespace wagonsight::device
