#include "recorded_sensor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <thread>

#include "linux/clocks.h"

namespace wagonsight {
namespace {

// Between the laps of a recording that has one frame a sensor and so no rate of its own.
constexpr Duration kLapMin = std::chrono::seconds(1);

}  // namespace

Result<std::unique_ptr<RecordedSensor>> RecordedSensor::open(const std::string& path) {
  // The unit has less memory than a recording is long.
  auto file = MappedFile::open(path, MappedFile::Pages::kOnDemand);
  if (!file) return tl::unexpected(file.error());
  std::unique_ptr<RecordedSensor> sensor(new RecordedSensor(std::move(*file)));
  auto reader = RecordingReader::open(sensor->file_.bytes(), DamagePolicy::kSkip);
  if (!reader) return fail(fmt::format("{}: {}", path, reader.error().message));
  sensor->reader_ = std::move(*reader);
  // Its calibration was read and copied; those pages would count as ours until playing passes them.
  sensor->file_.let_go(sensor->file_.bytes().size());
  return sensor;
}

RecordedSensor::RecordedSensor(MappedFile file) : file_(std::move(file)) {}

RecordedSensor::~RecordedSensor() {
  if (pool_ != nullptr) pool_->release(waiting_);
}

bool RecordedSensor::poll(Duration timeout, FramePool& pool, SpscRing<FrameSlot*>& frames) {
  pool_ = &pool;
  if (waiting_ == nullptr) {
    const bool more = read_next(pool);
    if (waiting_ == nullptr) return more;
  }
  const Duration ahead = waiting_->arrival - host_now();
  if (ahead > Duration::zero()) std::this_thread::sleep_for(std::min(ahead, timeout));
  if (ahead > timeout) return true;
  if (frames.try_push(waiting_)) {
    ++counters_.frames;
  } else {
    pool.release(waiting_);
    ++counters_.dropped;
  }
  waiting_ = nullptr;
  return true;
}

// Sets waiting_, or leaves it empty when there is nothing just now; false at the end.
bool RecordedSensor::read_next(FramePool& pool) {
  FrameSlot* slot = pool.acquire();
  if (slot == nullptr) {  // the recording waits, as no device would
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    return true;
  }
  const Result<bool> more = reader_->next(*slot);
  if (!more || !*more) {
    pool.release(slot);
    if (!more) ++counters_.damaged;
    return !more || (is_looped_ && begin_next_lap());
  }
  place_in_time(*slot);
  if (slot->damaged) ++counters_.damaged;
  waiting_ = slot;
  let_go_of_read_pages();
  return true;
}

// A lap is as long as its longest stream and one of that stream's periods. False without a frame.
bool RecordedSensor::begin_next_lap() {
  if (laps_ == 0) {
    for (const Stream& stream : streams_) {
      if (stream.frames == 0) continue;
      const auto steps = static_cast<std::int64_t>(stream.frames) - 1;
      const Duration span = stream.last - stream.first;
      lap_length_ = std::max(lap_length_, steps > 0 ? span + span / steps : kLapMin);
    }
  }
  if (lap_length_ <= Duration::zero()) return false;
  ++laps_;
  segment_ = 0;
  reader_->rewind();
  return true;
}

void RecordedSensor::place_in_time(FrameSlot& slot) {
  Stream& stream = streams_[slot.sensor_index];
  if (laps_ == 0) {
    if (stream.frames++ == 0) {
      stream.first = slot.instant;
      stream.first_sequence = slot.sequence;
      stream.first_ticks = slot.device_ticks;
    }
    stream.last = std::max(stream.last, slot.instant);
    stream.last_sequence = std::max(stream.last_sequence, slot.sequence);
    stream.last_ticks = std::max(stream.last_ticks, slot.device_ticks);
  } else {
    const std::uint32_t counted = stream.last_sequence - stream.first_sequence + 1;
    slot.sequence += static_cast<std::uint32_t>(laps_) * counted;
    const double span_s = to_seconds(stream.last - stream.first);
    if (span_s > 0) {
      const double rate = static_cast<double>(stream.last_ticks - stream.first_ticks) / span_s;
      slot.device_ticks += static_cast<std::uint64_t>(laps_) *
                           static_cast<std::uint64_t>(std::llround(rate * to_seconds(lap_length_)));
    }
  }
  const Duration moved = start_ - reader_->start() + laps_ * lap_length_;
  slot.instant += moved;
  slot.arrival += moved;
}

// What was read is not needed again; without this the whole file would count as ours.
void RecordedSensor::let_go_of_read_pages() {
  const std::size_t segment = reader_->cursor().segment_index();
  const auto& segments = reader_->mcap().segments();
  if (segment <= segment_ || segment >= segments.size()) return;
  segment_ = segment;
  file_.let_go(segments[segment].offset);
}

}  // namespace wagonsight
