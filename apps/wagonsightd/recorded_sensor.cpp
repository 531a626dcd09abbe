#include "recorded_sensor.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <thread>

#include "linux/clocks.h"

namespace wagonsight {
namespace {

// Unlike MappedFile not made resident: a recording is larger than the memory that the unit has.
Result<std::span<const std::byte>> map_lazily(const std::string& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return fail(fmt::format("{}: {}", path, std::strerror(errno)));
  struct stat status {};
  void* memory = MAP_FAILED;
  if (fstat(fd, &status) == 0 && status.st_size > 0)
    memory = mmap(nullptr, static_cast<std::size_t>(status.st_size), PROT_READ, MAP_PRIVATE, fd, 0);
  close(fd);
  if (memory == MAP_FAILED)
    return fail(fmt::format("{}: is empty or cannot be mapped; name a recording", path));
  return std::span(static_cast<const std::byte*>(memory), static_cast<std::size_t>(status.st_size));
}

}  // namespace

Result<std::unique_ptr<RecordedSensor>> RecordedSensor::open(const std::string& path) {
  const auto file = map_lazily(path);
  if (!file) return tl::unexpected(file.error());
  std::unique_ptr<RecordedSensor> sensor(new RecordedSensor(path, *file));
  auto reader = RecordingReader::open(*file, DamagePolicy::kSkip);
  if (!reader) return fail(fmt::format("{}: {}", path, reader.error().message));
  sensor->reader_ = std::move(*reader);
  return sensor;
}

RecordedSensor::RecordedSensor(std::string path, std::span<const std::byte> file)
    : path_(std::move(path)), file_(file) {}

RecordedSensor::~RecordedSensor() {
  if (pool_ != nullptr) pool_->release(waiting_);
  reader_.reset();
  munmap(const_cast<std::byte*>(file_.data()), file_.size());
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
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  const std::size_t done = segments[segment].offset / page * page;
  madvise(const_cast<std::byte*>(file_.data()), done, MADV_DONTNEED);
}

}  // namespace wagonsight
