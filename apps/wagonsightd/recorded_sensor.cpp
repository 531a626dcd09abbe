#include "recorded_sensor.h"

#include <fmt/format.h>

#include <algorithm>
#include <thread>

#include "linux/clocks.h"

namespace wagonsight {
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
    FrameSlot* slot = pool.acquire();
    if (slot == nullptr) {  // the recording waits, as no device would
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      return true;
    }
    const Result<bool> more = reader_->next(*slot);
    if (!more || !*more) {
      pool.release(slot);
      if (!more) ++counters_.damaged;
      return !more.has_value();
    }
    const Duration moved = start_ - reader_->start();
    slot->instant += moved;
    slot->arrival += moved;
    waiting_ = slot;
    let_go_of_read_pages();
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

// What was read is not needed again; without this the whole file would count as ours.
void RecordedSensor::let_go_of_read_pages() {
  const std::size_t segment = reader_->cursor().segment_index();
  const auto& segments = reader_->mcap().segments();
  if (segment <= segment_ || segment >= segments.size()) return;
  segment_ = segment;
  file_.let_go(segments[segment].offset);
}

}  // namespace wagonsight
