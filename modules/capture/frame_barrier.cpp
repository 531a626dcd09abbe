#include "capture/frame_barrier.h"

#include <algorithm>

namespace wagonsight {
namespace {

// Sets of different sensors could have the same instant, or change places; time must go on.
constexpr Duration kStepMin = std::chrono::milliseconds(1);

}  // namespace

bool FrameBarrier::next(HostTime now, FrameSet& set) {
  release_current();
  now_ = std::max(now_, now);
  if (!signal_) give_first_signal();
  if (!signal_) return false;
  discard_before_signal();
  const bool is_over = finished_ || now_ >= deadline();
  if (!is_over && !everybody_came()) return false;
  if (!anybody_came() && (finished_ || !options_.tick_when_silent)) {
    signal_.reset();
    return false;
  }
  emit(set);
  return true;
}

void FrameBarrier::give_first_signal() {
  for (const SensorQueue& queue : queues_)
    if (!queue.entries.empty() && (!signal_ || queue.entries[0].arrival < *signal_))
      signal_ = queue.entries[0].arrival;
}

void FrameBarrier::discard_before_signal() {
  for (std::size_t i = 0; i < kSensorsMax; ++i) {
    SensorQueue& queue = queues_[i];
    while (!queue.entries.empty() && queue.entries[0].arrival < *signal_) {
      drop_front(queue, was_missed_[i] ? queue.counters.late : queue.counters.superseded);
      was_missed_[i] = false;
    }
  }
}

bool FrameBarrier::anybody_came() const {
  return std::any_of(queues_.begin(), queues_.end(),
                     [](const SensorQueue& queue) { return !queue.entries.empty(); });
}

// When all are silent there is nobody to wait for, but nobody came either.
bool FrameBarrier::everybody_came() const {
  return anybody_came() &&
         std::all_of(queues_.begin(), queues_.end(), [&](const SensorQueue& queue) {
           return !queue.expected || !queue.entries.empty() || silent(queue);
         });
}

HostTime FrameBarrier::deadline() const {
  Duration longest{};
  for (const SensorQueue& queue : queues_)
    if (queue.expected && !silent(queue)) longest = std::max(longest, queue.period);
  return *signal_ + longest + options_.latency_max;
}

// Where nobody came: what is so old would be here.
HostTime FrameBarrier::instant_of_answers() const {
  std::optional<HostTime> first, last;
  for (const SensorQueue& queue : queues_) {
    if (queue.entries.empty()) continue;
    const HostTime instant = queue.entries[0].instant;
    first = first ? std::min(*first, instant) : instant;
    last = last ? std::max(*last, instant) : instant;
  }
  return first ? *first + (*last - *first) / 2 : deadline() - options_.latency_max;
}

void FrameBarrier::emit(FrameSet& set) {
  HostTime opened = *signal_;
  for (const SensorQueue& queue : queues_)
    if (!queue.entries.empty()) opened = std::max(opened, queue.entries[0].arrival);
  if (!everybody_came()) opened = std::max(opened, deadline());
  set = FrameSet{};
  set.index = set_count_++;
  set.instant = instant_of_answers();
  if (last_instant_) set.instant = std::max(set.instant, *last_instant_ + kStepMin);
  last_instant_ = set.instant;
  for (std::size_t i = 0; i < kSensorsMax; ++i)
    if (queues_[i].expected) set.sensors[i] = take(i, set.instant);
  signal_ = std::max(*signal_ + options_.barrier_timer, opened);
}

SensorFrame FrameBarrier::take(std::size_t sensor_index, HostTime instant) {
  SensorQueue& queue = queues_[sensor_index];
  was_missed_[sensor_index] = queue.entries.empty();
  if (queue.entries.empty())
    return {silent(queue) ? FrameState::kLost : FrameState::kLate, nullptr, {}};
  const FrameSlot* const slot = take_front(queue);
  if (slot == nullptr) return {FrameState::kDamaged, nullptr, {}};
  return {FrameState::kPresent, slot, slot->instant - instant};
}

}  // namespace wagonsight
