#include "frame_sets.h"

#include "base/check.h"

namespace wagonsight {
namespace {

// The queues of every sensor, the set that is handed out and the frame that arrives.
constexpr std::size_t kSlotsPerSensor = 10;

}  // namespace

FrameSetSource::FrameSetSource(RecordingReader& reader, const Rig& rig,
                               const FrameSetOptions& options)
    : reader_(reader),
      options_(options),
      sensor_count_(rig.sensors.size()),
      pool_(rig.sensors.size() == 1 ? 1 : kSlotsPerSensor * rig.sensors.size() + 1,
            reader.slot_bytes()) {
  for (std::size_t i = 0; i < sensor_count_; ++i) rates_hz_[i] = rig.sensors[i].rate_hz;
  rewind();
}

void FrameSetSource::rewind() {
  reader_.rewind();
  at_end_ = false;
  index_ = 0;
  pool_.release(arriving_);
  arriving_ = nullptr;
  if (sensor_count_ == 1) {
    if (slot_ == nullptr) slot_ = pool_.acquire();
  } else {
    grouping_ = make_frame_grouping(pool_, std::span(rates_hz_).first(sensor_count_), options_);
  }
}

Result<bool> FrameSetSource::next(FrameSet& set) {
  return sensor_count_ == 1 ? next_of_one(set) : next_of_many(set);
}

Result<bool> FrameSetSource::next_of_one(FrameSet& set) {
  auto more = reader_.next(*slot_);
  if (!more || !*more) return more;
  slot_->instant -= options_.stamp_delays[0];
  set = FrameSet{};
  set.index = index_++;
  set.instant = slot_->instant;
  if (slot_->damaged)
    set.sensors[0].state = FrameState::kDamaged;
  else
    set.sensors[0] = {FrameState::kPresent, slot_, Duration{}};
  return true;
}

Result<bool> FrameSetSource::next_of_many(FrameSet& set) {
  while (true) {
    if (grouping_->next(now_, set)) return true;
    if (arriving_ != nullptr) {
      grouping_->add(arriving_);
      arriving_ = nullptr;
      continue;
    }
    if (at_end_) return false;
    FrameSlot* slot = pool_.acquire();
    WS_CHECK(slot != nullptr, "%zu slots in use", pool_.in_use());
    auto more = reader_.next(*slot);
    if (!more || !*more) {
      pool_.release(slot);
      if (!more) return more;
      at_end_ = true;
      grouping_->finish();
      continue;
    }
    // Sets are taken before the frame is added, so that silence is seen as it was live.
    arriving_ = slot;
    now_ = slot->arrival;
  }
}

}  // namespace wagonsight
