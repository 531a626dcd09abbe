#include "pulse_thread.h"

#include "linux/sealed_heap.h"
#include "linux/threads.h"

namespace wagonsight {
namespace {

constexpr Duration kPollTimeout = std::chrono::milliseconds(20);  // less than between two ticks
constexpr int kRealtime = 21;  // above the sensors, for it has but a word to say

}  // namespace

void PulseThread::start() {
  if (pulses_ != nullptr) thread_ = std::thread([this] { run(); });
}

void PulseThread::stop() {
  stop_.store(true, std::memory_order_release);
  if (thread_.joinable()) thread_.join();
}

void PulseThread::run() {
  name_this_thread("trigger");
  (void)make_this_thread_realtime(kRealtime);  // where allowed
  const HeapSeal seal;
  while (!stop_.load(std::memory_order_acquire)) {
    if (const HostTime tick = last_tick_(); tick != HostTime{}) pulses_->observe(tick);
    pulses_->poll(kPollTimeout);
  }
}

}  // namespace wagonsight
