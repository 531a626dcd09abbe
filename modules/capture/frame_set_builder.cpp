#include "capture/frame_set_builder.h"

#include <algorithm>

namespace wagonsight {
namespace {

// Parts of a period, or of a way.
constexpr int kSameRate = 50;    // periods that differ by less are equal
constexpr int kClearly = 16;     // a gap that is wider by so much is clearly wider
constexpr int kPhaseGain = 16;   // of the way to the middle of the phases, the tick goes at once
constexpr int kWiderTicks = 30;  // jitter does not keep an equal gap the wider one for so many

// How old a frame may be and still be taken before a newer one.
constexpr Duration inertia(Duration period) {
  return period * 3 / 5;
}

}  // namespace

int FrameSetBuilder::choose_reference() const {
  // At a start that takes long, all of the first frames may be old before anybody asks. Without a
  // tick of theirs they would lie here for good, and with them the buffers of all that follow.
  const auto waits = [&](const SensorQueue& queue) {
    return !last_tick_ && !queue.entries.empty();
  };
  const auto usable = [&](const SensorQueue& queue) {
    return queue.seen && (!silent(queue) || waits(queue));
  };
  int fastest = -1;
  for (std::size_t i = 0; i < kSensorsMax; ++i) {
    if (!usable(queues_[i])) continue;
    if (fastest < 0 || queues_[i].period < queues_[static_cast<std::size_t>(fastest)].period)
      fastest = static_cast<int>(i);
  }
  if (fastest < 0 || reference_ < 0) return fastest;
  const SensorQueue& current = queues_[static_cast<std::size_t>(reference_)];
  const bool a_quarter_faster =
      4 * queues_[static_cast<std::size_t>(fastest)].period < 3 * current.period;
  return usable(current) && !a_quarter_faster ? reference_ : fastest;
}

bool FrameSetBuilder::deadline_passed(const Tick& tick) const {
  return finished_ || now_ >= tick.instant + tick.period / 2 + options_.latency_max;
}

std::optional<FrameSetBuilder::Tick> FrameSetBuilder::find_tick() {
  reference_ = choose_reference();
  if (reference_ < 0) return find_silent_tick();
  if (planned_reference_ != reference_) plan_phase();
  SensorQueue& queue = queues_[static_cast<std::size_t>(reference_)];
  Tick regular{{}, queue.period, reference_};
  const Duration phase = planned_reference_ == reference_ ? phase_ : Duration{};

  // A frame that answers to a tick that has passed makes no tick of its own.
  while (last_tick_ && !queue.entries.empty()) {
    const HostTime instant = queue.entries[0].instant + phase;
    const bool own_pace = last_tick_->reference == reference_;
    if (instant > last_tick_->instant + (own_pace ? Duration{} : regular.period / 2)) break;
    drop_front(queue, queue.counters.late);
  }
  const Entry* frame = queue.entries.empty() ? nullptr : queue.entries.begin();
  if (frame != nullptr) regular.instant = frame->instant + phase;
  if (last_tick_)
    if (const auto gap = find_gap_tick(regular, frame)) return gap;
  return frame == nullptr ? std::nullopt : std::optional(regular);
}

// A tick where the reference has no frame and another sensor has one: at the instant of the frame
// that is missing, or of the other's frame when that is further away.
std::optional<FrameSetBuilder::Tick> FrameSetBuilder::find_gap_tick(
    const Tick& regular, const Entry* reference_frame) const {
  const HostTime missing = last_tick_->instant + regular.period;
  if (reference_frame != nullptr && regular.instant < missing + regular.period / 2)
    return std::nullopt;
  const Entry* other = nullptr;
  for (const SensorQueue& queue : queues_) {
    for (const Entry& entry : queue.entries) {
      if (entry.instant <= last_tick_->instant + regular.period / 2) continue;
      if (other == nullptr || entry.instant < other->instant) other = &entry;
      break;
    }
  }
  if (other == nullptr || other == reference_frame) return std::nullopt;
  Tick gap{missing, regular.period, kGapTick};
  if (other->instant >= missing + regular.period / 2) gap.instant = other->instant;
  // Frames of one sensor come in order: a later one of the reference proves that this is missing.
  // One that the gap would take is not missing: the cut has moved the ticks on. A gap instead would
  // be followed by the next one, and the ticks would never come to where they are planned.
  if (reference_frame != nullptr) {
    const HostTime window_end = gap.instant + regular.period / 2;
    const bool is_missing = regular.instant >= window_end && reference_frame->instant >= window_end;
    return is_missing ? std::optional(gap) : std::nullopt;
  }
  return deadline_passed(gap) ? std::optional(gap) : std::nullopt;
}

std::optional<FrameSetBuilder::Tick> FrameSetBuilder::find_silent_tick() const {
  if (!options_.tick_when_silent || finished_ || !last_tick_) return std::nullopt;
  const bool first = last_tick_->reference != kSilentTick;
  Tick tick{last_tick_->instant + (first ? options_.silent_after : last_tick_->period),
            last_tick_->period, kSilentTick};
  return deadline_passed(tick) ? std::optional(tick) : std::nullopt;
}

// True when the sensor cannot give a nearer frame for this tick any more.
bool FrameSetBuilder::settled(const SensorQueue& queue, const Tick& tick) const {
  if (!queue.expected || silent(queue)) return true;
  const HostTime window_end = tick.instant + tick.period / 2;
  for (const Entry& entry : queue.entries)
    if (entry.instant >= tick.instant - inertia(tick.period)) return true;
  return queue.seen && queue.last_instant + queue.period >= window_end;
}

bool FrameSetBuilder::settled(const Tick& tick) const {
  return deadline_passed(tick) || std::all_of(queues_.begin(), queues_.end(),
                                              [&](const auto& q) { return settled(q, tick); });
}

bool FrameSetBuilder::next(HostTime now, FrameSet& set) {
  release_current();
  now_ = std::max(now_, now);
  const auto tick = find_tick();
  if (!tick && finished_) {
    for (SensorQueue& queue : queues_)
      while (!queue.entries.empty()) drop_front(queue, queue.counters.late);
  }
  if (!tick || !settled(*tick)) return false;
  emit(*tick, set);
  return true;
}

void FrameSetBuilder::emit(const Tick& tick, FrameSet& set) {
  set = FrameSet{};
  set.index = set_count_++;
  set.instant = tick.instant;
  for (std::size_t i = 0; i < kSensorsMax; ++i)
    if (queues_[i].expected) set.sensors[i] = take_nearest(queues_[i], tick);
  last_tick_ = tick;
  plan_phase();
}

// Once a tick, and when the reference changes, so that it does not matter how often next() asks.
void FrameSetBuilder::plan_phase() {
  if (reference_ < 0) return;
  const SensorQueue& reference = queues_[static_cast<std::size_t>(reference_)];
  const Duration period = reference.period;
  FixedVector<Duration, kSensorsMax> phases;  // behind the reference's frame, in [0, period)
  for (const SensorQueue& queue : queues_) {
    const bool is_counted = queue.periods.size() >= kPeriodsNeeded && !silent(queue);
    if (!is_counted || abs(queue.period - period) > period / kSameRate) continue;
    const Duration behind = (queue.last_instant - reference.last_instant) % period;
    phases.push_back(behind < Duration{} ? behind + period : behind);
  }
  if (phases.empty()) return;
  std::sort(phases.begin(), phases.end());
  const bool is_new = planned_reference_ != reference_;
  // Each gap follows a phase; the cut lies half a period before the tick.
  const auto gap_behind = [&](std::size_t i) {
    return i + 1 < phases.size() ? phases[i + 1] - phases[i] : phases[0] + period - phases[i];
  };
  const auto middle_beside = [&](std::size_t i) {  // of the phases when cut in this gap
    return phases[i] + (gap_behind(i) + period) / 2;
  };
  const auto from_now = [&](Duration tick) {  // how far the tick would move, at most half a period
    const Duration step = (tick - phase_) % period;
    return step > period / 2 ? step - period : step <= -period / 2 ? step + period : step;
  };
  std::size_t widest = 0;
  std::size_t present = 0;
  for (std::size_t i = 1; i < phases.size(); ++i) {
    if (gap_behind(i) > gap_behind(widest)) widest = i;
    if (abs(from_now(middle_beside(i))) < abs(from_now(middle_beside(present)))) present = i;
  }
  const Duration gain = gap_behind(widest) - gap_behind(present);
  wider_for_ = gain > Duration{} ? wider_for_ + 1 : 0;
  const bool moves = is_new || gain > period / kClearly || wider_for_ >= kWiderTicks;
  const Duration step = from_now(middle_beside(moves ? widest : present));
  phase_ += moves ? step : step / kPhaseGain;
  if (moves) wider_for_ = 0;
  // The tick belongs to the nearest frame of the reference.
  if (phase_ > period / 2) phase_ -= period;
  if (phase_ <= -period / 2) phase_ += period;
  planned_reference_ = reference_;
}

SensorFrame FrameSetBuilder::take_nearest(SensorQueue& queue, const Tick& tick) {
  const HostTime window_begin = tick.instant - tick.period;
  const HostTime window_end = tick.instant + tick.period / 2;
  auto& entries = queue.entries;
  while (!entries.empty() && entries[0].instant <= window_begin)
    drop_front(queue, queue.counters.late);
  bool damaged = false;
  while (!entries.empty() && entries[0].instant < window_end) {
    const bool better_follows = entries[0].instant < tick.instant - inertia(tick.period) &&
                                entries.size() > 1 && entries[1].slot != nullptr &&
                                entries[1].instant < window_end;
    if (entries[0].slot == nullptr || better_follows) {
      damaged = damaged || entries[0].slot == nullptr;
      drop_front(queue, queue.counters.superseded);
      continue;
    }
    const FrameSlot* const slot = take_front(queue);
    return {FrameState::kPresent, slot, slot->instant - tick.instant};
  }
  if (damaged) return {FrameState::kDamaged, nullptr, {}};
  if (silent(queue)) return {FrameState::kLost, nullptr, {}};
  return {missing(queue, tick) ? FrameState::kLate : FrameState::kNotDue, nullptr, {}};
}

// Should the sensor, which is not silent, have had a frame for this tick?
bool FrameSetBuilder::missing(const SensorQueue& queue, const Tick& tick) const {
  if (!queue.seen) return true;
  if (!queue.left_instant) return false;  // it has just begun
  const bool hole = queue.entries.empty() ||
                    2 * (queue.entries[0].instant - *queue.left_instant) > 3 * queue.period;
  return hole && *queue.left_instant + queue.period < tick.instant + tick.period / 2;
}

}  // namespace wagonsight
