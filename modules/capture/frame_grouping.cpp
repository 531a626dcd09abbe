#include "capture/frame_grouping.h"

#include <algorithm>

#include "base/check.h"
#include "capture/frame_barrier.h"
#include "capture/frame_set_builder.h"

namespace wagonsight {
namespace {

// An instant is before its arrival by the clock fit's design; a second is beyond any doubt.
constexpr Duration kImplausibleLead = std::chrono::seconds(1);

}  // namespace

FrameGrouping::FrameGrouping(FramePool& pool, std::span<const double> rates_hz,
                             const FrameSetOptions& options)
    : pool_(pool), options_(options) {
  WS_CHECK(rates_hz.size() <= kSensorsMax, "%zu sensors", rates_hz.size());
  for (std::size_t i = 0; i < rates_hz.size(); ++i) {
    if (rates_hz[i] <= 0) continue;
    queues_[i].expected = true;
    queues_[i].nominal_period = queues_[i].period = from_seconds(1.0 / rates_hz[i]);
  }
}

FrameGrouping::~FrameGrouping() {
  release_current();
  for (SensorQueue& queue : queues_)
    for (const Entry& entry : queue.entries) pool_.release(entry.slot);
}

const FrameGrouping::SensorQueue& FrameGrouping::state(std::size_t sensor_index) const {
  WS_CHECK(sensor_index < kSensorsMax, "sensor %zu", sensor_index);
  return queues_[sensor_index];
}

void FrameGrouping::add(FrameSlot* slot) {
  WS_CHECK(slot != nullptr && state(slot->sensor_index).expected, "frame of an unknown sensor %d",
           slot == nullptr ? -1 : slot->sensor_index);
  SensorQueue& queue = queues_[slot->sensor_index];
  Counters& counters = queue.counters;
  ++counters.received;
  const auto refuse = [&](std::uint64_t& cause) {
    ++cause;
    pool_.release(slot);
  };
  slot->instant -= options_.stamp_delays[slot->sensor_index];
  const HostTime instant = slot->instant;
  const HostTime arrival = slot->arrival;
  if (instant > arrival + kImplausibleLead) return refuse(counters.implausible);
  if (queue.seen && instant == queue.last_instant) return refuse(counters.duplicates);
  if (queue.seen && instant < queue.last_instant) return refuse(counters.out_of_order);

  if (!started_) started_ = instant;
  now_ = std::max(now_, instant);
  if (queue.seen) measure_period(queue, instant - queue.last_instant);
  queue.seen = true;
  queue.last_instant = instant;
  if (queue.entries.full()) drop_front(queue, counters.overrun);
  if (slot->damaged) {
    pool_.release(slot);
    ++counters.damaged;
    slot = nullptr;
  }
  queue.entries.push_back({slot, instant, arrival});
}

void FrameGrouping::measure_period(SensorQueue& queue, Duration step) {
  if (queue.periods.full()) {
    queue.periods[queue.period_cursor] = step;
    queue.period_cursor = (queue.period_cursor + 1) % kPeriodsMax;
  } else {
    queue.periods.push_back(step);
  }
  if (queue.periods.size() < kPeriodsNeeded) return;
  auto sorted = queue.periods;
  auto* middle = sorted.begin() + (sorted.size() - 1) / 2;
  std::nth_element(sorted.begin(), middle, sorted.end());
  queue.period = *middle;
}

// A damaged frame was counted when it came.
void FrameGrouping::drop_front(SensorQueue& queue, std::uint64_t& cause) {
  auto& entries = queue.entries;
  queue.left_instant = entries[0].instant;
  if (entries[0].slot != nullptr) {
    ++cause;
    pool_.release(entries[0].slot);
  }
  std::copy(entries.begin() + 1, entries.end(), entries.begin());
  entries.pop_back();
}

FrameSlot* FrameGrouping::take_front(SensorQueue& queue) {
  FrameSlot* const slot = queue.entries[0].slot;
  if (slot != nullptr) {
    current_.push_back(slot);
    ++queue.counters.used;
    queue.entries[0].slot = nullptr;
  }
  drop_front(queue, queue.counters.superseded);  // counts nothing: the slot has left
  return slot;
}

bool FrameGrouping::silent(const SensorQueue& queue) const {
  if (!started_) return false;
  const HostTime last = queue.seen ? queue.last_instant : *started_;
  return now_ - last > std::max(options_.silent_after, 3 * queue.period);
}

void FrameGrouping::release_current() {
  for (FrameSlot* slot : current_) pool_.release(slot);
  current_.clear();
}

std::unique_ptr<FrameGrouping> make_frame_grouping(FramePool& pool,
                                                   std::span<const double> rates_hz,
                                                   const FrameSetOptions& options) {
  if (options.grouping == Grouping::kBarrier)
    return std::make_unique<FrameBarrier>(pool, rates_hz, options);
  return std::make_unique<FrameSetBuilder>(pool, rates_hz, options);
}

}  // namespace wagonsight
