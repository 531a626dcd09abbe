#include "frame_source.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <optional>

#include "base/check.h"
#include "linux/sealed_heap.h"
#include "linux/threads.h"

namespace wagonsight {
namespace {

constexpr std::size_t kRingSlots = 64;  // two seconds of one sensor, half of one of four
constexpr Duration kPollTimeout = std::chrono::milliseconds(100);
constexpr int kBackgroundNice = 2;
constexpr int kDeviceRealtime = 20;  // above nothing but ordinary threads

}  // namespace

FrameBell::FrameBell() : fd_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  WS_CHECK(fd_ >= 0, "eventfd gave %d", fd_);
}
FrameBell::~FrameBell() {
  close(fd_);
}
void FrameBell::ring() {
  const std::uint64_t one = 1;
  (void)!write(fd_, &one, sizeof one);  // full means that it rings already
}
void FrameBell::wait(Duration timeout) {
  pollfd wanted{fd_, POLLIN, 0};
  const timespec time{timeout.count() / 1'000'000'000, timeout.count() % 1'000'000'000};
  if (ppoll(&wanted, 1, &time, nullptr) <= 0) return;
  std::uint64_t rings = 0;
  (void)!read(fd_, &rings, sizeof rings);
}

SourceThread::SourceThread(FrameSource source, FramePool& pool, FrameBell& bell,
                           FrameWitness* witness)
    : source_(std::move(source)),
      pool_(pool),
      bell_(bell),
      witness_(witness),
      own_ring_(kRingSlots),
      ring_(kRingSlots) {}

SourceThread::~SourceThread() {
  stop();
}

void SourceThread::start() {
  thread_ = std::thread([this] { run(); });
}

void SourceThread::stop() {
  stop_.store(true, std::memory_order_release);
  if (thread_.joinable()) thread_.join();
}

void SourceThread::run() {
  name_this_thread(name());
  if (source_.is_background_work) (void)make_this_thread_nice(kBackgroundNice);
  if (source_.is_device) (void)make_this_thread_realtime(kDeviceRealtime);  // where allowed
  std::optional<HeapSeal> seal;
  if (!source_.allocates) seal.emplace();
  bool going_on = true;
  while (going_on && !stop_.load(std::memory_order_acquire)) {
    going_on = source_.sensor->poll(kPollTimeout, pool_, own_ring_);
    hand_on();
    turns_.fetch_add(1, std::memory_order_relaxed);
    tell_counters();
    if (ring_.size() > 0) bell_.ring();
  }
  ended_.store(true, std::memory_order_release);
}

void SourceThread::hand_on() {
  FrameSlot* slot = nullptr;
  while (own_ring_.try_pop(slot)) {
    const std::uint8_t index = slot->sensor_index < kSensorsMax
                                   ? source_.rig_index[slot->sensor_index]
                                   : FrameSource::kNone;
    const bool is_wanted = index != FrameSource::kNone;
    slot->sensor_index = index;
    if (is_wanted && witness_ != nullptr) witness_->offer(*slot);
    if (is_wanted && ring_.try_push(slot)) continue;
    pool_.release(slot);
    if (is_wanted) ++overrun_;
  }
}

void SourceThread::tell_counters() {
  const Sensor::Counters now = source_.sensor->counters();
  frames_.store(now.frames, std::memory_order_relaxed);
  dropped_.store(now.dropped + overrun_, std::memory_order_relaxed);
  damaged_.store(now.damaged, std::memory_order_relaxed);
  resets_.store(now.resets, std::memory_order_relaxed);
  const std::string_view trouble = source_.sensor->trouble();
  trouble_.store(trouble.empty() ? nullptr : trouble.data(), std::memory_order_relaxed);
}

SourceThread::Counters SourceThread::counters() const {
  return {frames_.load(std::memory_order_relaxed), dropped_.load(std::memory_order_relaxed),
          damaged_.load(std::memory_order_relaxed), resets_.load(std::memory_order_relaxed)};
}

bool SourceThread::is_only_source_of(std::size_t sensor_index) const {
  return std::all_of(source_.rig_index.begin(), source_.rig_index.end(),
                     [&](std::uint8_t index) {
                       return index == FrameSource::kNone || index == sensor_index;
                     }) &&
         std::any_of(source_.rig_index.begin(), source_.rig_index.end(),
                     [&](std::uint8_t index) { return index == sensor_index; });
}

std::string_view SourceThread::trouble() const {
  const char* text = trouble_.load(std::memory_order_relaxed);
  return text == nullptr ? std::string_view{} : std::string_view(text);
}

FrameSlot* SourceThread::take() {
  FrameSlot* slot = nullptr;
  return ring_.try_pop(slot) ? slot : nullptr;
}

}  // namespace wagonsight
