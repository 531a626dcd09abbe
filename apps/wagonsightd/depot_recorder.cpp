#include "depot_recorder.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <ctime>
#include <new>

#include "linux/clocks.h"
#include "linux/threads.h"

namespace wagonsight {
namespace {

using std::chrono::milliseconds;

constexpr int kNice = 10;
constexpr Duration kLook = milliseconds(10);
constexpr Duration kSyncEvery = milliseconds(400);
constexpr Duration kTryAgain = std::chrono::seconds(1);
constexpr Duration kRestMax = std::chrono::seconds(2);  // for what waits when the end has come
constexpr std::size_t kSlotsMin = 8;
constexpr std::uint32_t kFilesMax = 100'000;

std::string date_text() {
  const WallTime wall = wall_now();
  if (!wall.synchronised) return "undated";
  const auto seconds = static_cast<std::time_t>(wall.unix_s);
  std::tm date{};
  std::array<char, 32> text{};
  gmtime_r(&seconds, &date);
  return {text.data(), std::strftime(text.data(), text.size(), "%Y%m%dT%H%M%SZ", &date)};
}

}  // namespace

// The file as the writer sees it; knows how much of it is whole records.
class DepotRecorder::Sink final : public ByteSink {
 public:
  explicit Sink(std::unique_ptr<RecordingFile> file) : file_(std::move(file)) {}
  Result<void> write(std::span<const std::byte> bytes) override {
    auto done = file_->append(bytes);
    if (done) whole_bytes_ += bytes.size();
    return done;
  }
  RecordingFile& file() { return *file_; }
  std::uint64_t whole_bytes() const { return whole_bytes_; }

 private:
  std::unique_ptr<RecordingFile> file_;
  std::uint64_t whole_bytes_ = 0;
};

DepotRecorder::DepotRecorder(const Rig& rig, std::size_t slot_bytes, DepotOptions options,
                             RecordingDisk& disk)
    : rig_(rig), slot_bytes_(slot_bytes), options_(std::move(options)), disk_(disk) {}

DepotRecorder::~DepotRecorder() {
  stop();
  if (thread_.joinable()) thread_.join();
}

Result<void> DepotRecorder::start(Duration length) {
  const HostTime end = host_now() + length;
  {
    const std::lock_guard hold(mutex_);
    if (is_running_ && stop_)
      return fail("recording: the last one is still being finished; try again");
    if (is_running_) {
      end_ = end;
      return {};
    }
  }
  if (thread_.joinable()) thread_.join();
  const std::size_t slots = std::max(kSlotsMin, options_.memory_bytes / slot_bytes_);
  try {
    memory_ = std::make_unique<FramePool>(slots, slot_bytes_);
    queue_.assign(slots, nullptr);
  } catch (const std::bad_alloc&) {
    memory_.reset();
    return fail(
        fmt::format("recording: there is no memory for {} frames; lower "
                    "recording.memory_mb in the settings",
                    slots));
  }
  queue_begin_ = queue_size_ = 0;
  {
    const std::lock_guard hold(mutex_);
    status_ = {};
    status_.state = RecordingState::kOn;
    end_ = end;
  }
  try_again_ = {};
  synced_ = host_now();
  frames_in_chunk_ = frames_done_ = bytes_done_ = 0;
  files_ = 0;
  stop_ = false;
  is_running_ = true;
  accepts_ = true;
  thread_ = std::thread([this] { run(); });
  return {};
}

void DepotRecorder::stop() {
  stop_ = true;
}

RecordingStatus DepotRecorder::status() const {
  const std::lock_guard hold(mutex_);
  RecordingStatus status = status_;
  if (status.state != RecordingState::kOff)
    status.ends_in_s = std::max(0.0, to_seconds(end_ - host_now()));
  return status;
}

void DepotRecorder::tell_vehicle(const VehicleStateMessage& state) {
  const std::lock_guard hold(mutex_);
  if (vehicle_news_.size() == kNewsMax) vehicle_news_.erase(vehicle_news_.begin());
  vehicle_news_.push_back(state);
}

// ---- the sensors' threads

void DepotRecorder::offer(const FrameSlot& frame) {
  if (!accepts_.load(std::memory_order_relaxed)) return;
  FrameSlot* copy = take_free();
  if (copy == nullptr) return;
  const std::span<std::byte> bytes = copy->bytes;
  *copy = frame;
  copy->bytes = bytes;
  const std::size_t images = rig_.sensors[frame.sensor_index].kind == SensorKind::kStereo ? 2 : 1;
  std::memcpy(bytes.data(), frame.bytes.data(), frame.image_bytes() * images);
  put(copy);
}

FrameSlot* DepotRecorder::take_free() {
  const std::lock_guard hold(mutex_);
  if (!accepts_) return nullptr;
  FrameSlot* slot = memory_->acquire();
  if (slot == nullptr) {
    ++status_.dropped;  // the oldest one, or this one when none waits
    slot = pop_oldest();
  }
  if (slot != nullptr) ++copying_;
  return slot;
}

void DepotRecorder::put(FrameSlot* slot) {
  const std::lock_guard hold(mutex_);
  --copying_;
  queue_[(queue_begin_ + queue_size_) % queue_.size()] = slot;
  ++queue_size_;
}

FrameSlot* DepotRecorder::pop_oldest() {
  if (queue_size_ == 0) return nullptr;
  FrameSlot* slot = queue_[queue_begin_];
  queue_begin_ = (queue_begin_ + 1) % queue_.size();
  --queue_size_;
  return slot;
}

FrameSlot* DepotRecorder::take_oldest() {
  const std::lock_guard hold(mutex_);
  return pop_oldest();
}

// ---- the recorder's thread

void DepotRecorder::run() {
  name_this_thread("recorder");
  (void)make_this_thread_nice(kNice);
  if (const auto made = disk_.make_folder(options_.folder); !made) take_failure(made.error());
  while (true) {
    const HostTime now = host_now();
    if (is_over(now)) break;
    FrameSlot* slot = now < try_again_ ? nullptr : take_oldest();
    write_vehicle();
    if (slot != nullptr) {
      write(*slot);
      memory_->release(slot);
    }
    sync_when_due(now);
    tell_progress();
    if (slot == nullptr) std::this_thread::sleep_for(kLook);
  }
  write_rest();
  write_vehicle();
  if (const auto closed = close_file(); !closed) take_failure(closed.error());
  tell_progress();
  {
    const std::lock_guard hold(mutex_);
    memory_.reset();
    status_.state = RecordingState::kOff;
  }
  is_running_ = false;
}

bool DepotRecorder::is_over(HostTime now) {
  const std::lock_guard hold(mutex_);
  if (now >= end_) stop_ = true;  // from here on start() does not lengthen it
  return stop_;
}

void DepotRecorder::write(const FrameSlot& slot) {
  if (writer_ != nullptr && slot.arrival - file_begin_ >= options_.file_length)
    if (const auto closed = close_file(); !closed) take_failure(closed.error());
  ++frames_in_chunk_;
  if (writer_ == nullptr)
    if (const auto opened = open_file(slot); !opened) return take_failure(opened.error());
  const std::uint64_t before = sink_->whole_bytes();
  if (const auto done = writer_->write(slot); !done) return take_failure(done.error());
  if (sink_->whole_bytes() == before) return;
  frames_done_ += frames_in_chunk_;
  frames_in_chunk_ = 0;
}

// While no file is open only the newest is kept, for the next one.
void DepotRecorder::write_vehicle() {
  std::vector<VehicleStateMessage> news;
  {
    const std::lock_guard hold(mutex_);
    news.swap(vehicle_news_);
  }
  for (VehicleStateMessage& state : news) {
    vehicle_ = std::move(state);
    if (writer_ == nullptr) continue;
    if (const auto done = writer_->write(*vehicle_); !done) take_failure(done.error());
  }
}

// What came before the end belongs to the recording, as far as the disk takes it soon.
void DepotRecorder::write_rest() {
  const HostTime give_up = host_now() + kRestMax;
  accepts_ = false;
  while (true) {
    bool is_still = false;
    {
      const std::lock_guard hold(mutex_);
      is_still = copying_ == 0;  // nobody begins a copy any more
    }
    FrameSlot* slot = take_oldest();
    if (slot == nullptr && is_still) break;
    if (slot == nullptr) {
      std::this_thread::sleep_for(kLook);
      continue;
    }
    if (host_now() < give_up && host_now() >= try_again_) {
      write(*slot);
    } else {
      const std::lock_guard hold(mutex_);
      ++status_.dropped;
    }
    memory_->release(slot);
  }
}

Result<std::string> DepotRecorder::free_path() {
  const std::string date = date_text();
  while (file_number_ < kFilesMax) {
    const std::string path =
        fmt::format("{}/recording-{}-{:03}.mcap", options_.folder, date, ++file_number_);
    if (!disk_.exists(path)) return path;
  }
  return fail(fmt::format("{}: is full of recordings; take some away", options_.folder));
}

Result<void> DepotRecorder::open_file(const FrameSlot& first) {
  const auto free = disk_.free_bytes(options_.folder);
  if (!free) return tl::unexpected(free.error());
  if (*free < options_.free_bytes_min) {
    stop_ = true;
    return fail(fmt::format("{}: less than {} MB are free; take recordings away", options_.folder,
                            options_.free_bytes_min >> 20U));
  }
  const auto path = free_path();
  if (!path) return tl::unexpected(path.error());
  auto file = disk_.create(*path);
  if (!file) return tl::unexpected(file.error());
  sink_ = std::make_unique<Sink>(std::move(*file));
  RecordingOptions recording;
  recording.mcap.library = options_.made_by;
  recording.has_vehicle = options_.has_vehicle;
  recording.start = first.arrival;
  recording.provenance = {{"made_by", options_.made_by}, {"source", "depot"}};
  const WallTime wall = wall_now();
  if (wall.synchronised)
    recording.provenance.emplace_back("started_unix", fmt::format("{:.3f}", wall.unix_s));
  auto writer = RecordingWriter::create(*sink_, rig_, recording);
  if (!writer) return tl::unexpected(writer.error());
  writer_ = std::move(*writer);
  file_begin_ = first.arrival;
  ++files_;
  if (vehicle_) {
    vehicle_->stamp = first.arrival;  // it holds when the file begins
    if (auto done = writer_->write(*vehicle_); !done) return done;
  }
  const std::lock_guard hold(mutex_);
  status_.state = RecordingState::kOn;
  status_.trouble = {};
  return {};
}

Result<void> DepotRecorder::close_file() {
  if (writer_ == nullptr) return {};
  auto done = writer_->finish();
  if (done) done = sink_->file().sync();
  if (!done) return done;
  frames_done_ += frames_in_chunk_;
  frames_in_chunk_ = 0;
  bytes_done_ += sink_->whole_bytes();
  writer_.reset();
  sink_.reset();
  return {};
}

// Also ends the recording when the disk is nearly full.
void DepotRecorder::sync_when_due(HostTime now) {
  if (writer_ == nullptr || now - synced_ < kSyncEvery) return;
  auto done = writer_->flush();
  if (done) {
    frames_done_ += frames_in_chunk_;
    frames_in_chunk_ = 0;
    done = sink_->file().sync();
  }
  if (!done) return take_failure(done.error());
  synced_ = host_now();
  const auto free = disk_.free_bytes(options_.folder);
  if (!free || *free >= options_.free_bytes_min) return;
  stop_ = true;
  const std::lock_guard hold(mutex_);
  status_.trouble = std::string_view(fmt::format("It ended early: less than {} MB are free in {}.",
                                                 options_.free_bytes_min >> 20U, options_.folder));
}

// The file stays, as far as its records are whole; the next frame begins another one.
void DepotRecorder::take_failure(const Error& error) {
  writer_.reset();
  if (sink_ != nullptr) {
    (void)sink_->file().cut_to(sink_->whole_bytes());
    (void)sink_->file().sync();
    bytes_done_ += sink_->whole_bytes();
    sink_.reset();
  }
  try_again_ = host_now() + kTryAgain;
  const std::lock_guard hold(mutex_);
  status_.dropped += frames_in_chunk_;
  frames_in_chunk_ = 0;
  status_.state = RecordingState::kNoDisk;
  status_.trouble = std::string_view(error.message + ".");
}

void DepotRecorder::tell_progress() {
  const std::lock_guard hold(mutex_);
  status_.frames = frames_done_;
  status_.bytes = bytes_done_ + (sink_ == nullptr ? 0 : sink_->whole_bytes());
  status_.files = files_;
}

}  // namespace wagonsight
