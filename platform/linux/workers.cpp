#include "linux/workers.h"

#include <fmt/format.h>

#include "base/check.h"
#include "linux/clocks.h"
#include "linux/held_memory.h"
#include "linux/resources.h"
#include "linux/sealed_heap.h"
#include "linux/threads.h"

namespace wagonsight {
namespace {

constexpr Duration kTurn = std::chrono::milliseconds(100);

}  // namespace

Workers::Workers(std::size_t count) {
  for (std::size_t i = 1; i < count; ++i) helpers_.push_back(std::make_unique<Helper>());
}

Workers::~Workers() {
  stop();
}

void Workers::start() {
  WS_CHECK(!is_started_, "%zu workers are started already", workers());
  is_started_ = true;
  stop_ = false;
  for (std::size_t i = 0; i < helpers_.size(); ++i)
    helpers_[i]->thread = std::thread([this, i] { help(i); });
  std::unique_lock lock(mutex_);
  end_.wait(lock, [this] { return ready_ == helpers_.size(); });
}

void Workers::stop() {
  if (!is_started_) return;
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  begin_.notify_all();
  for (auto& helper : helpers_) helper->thread.join();
  ready_ = 0;
  is_started_ = false;
}

void Workers::run(std::size_t count, void* job, Part part) {
  if (!is_started_ || helpers_.empty() || count < 2) {
    for (std::size_t i = 0; i < count; ++i) part(job, i, 0);
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    job_ = job;
    part_ = part;
    part_count_ = count;
    next_.store(0, std::memory_order_relaxed);
    is_open_ = true;
    ++jobs_;
  }
  begin_.notify_all();
  take_parts(0, nullptr);
  // Nobody comes in any more; who is still at a part is waited for.
  std::unique_lock lock(mutex_);
  is_open_ = false;
  end_.wait(lock, [this] { return at_work_ == 0; });
}

void Workers::take_parts(std::size_t worker, Helper* helper) {
  while (true) {
    const std::size_t part = next_.fetch_add(1, std::memory_order_relaxed);
    if (part >= part_count_) return;
    part_(job_, part, worker);
    if (helper != nullptr) helper->turns.fetch_add(1, std::memory_order_relaxed);
  }
}

void Workers::help(std::size_t index) {
  Helper& helper = *helpers_[index];
  name_this_thread(fmt::format("worker {}", index + 1));
  hold_this_stack();
  const HeapSeal seal;
  tell(helper);
  std::uint64_t jobs_seen = 0;
  std::unique_lock lock(mutex_);
  ++ready_;
  end_.notify_one();
  while (!stop_) {
    helper.turns.fetch_add(1, std::memory_order_relaxed);
    const auto is_wanted = [&] { return stop_ || (is_open_ && jobs_ != jobs_seen); };
    if (!begin_.wait_for(lock, kTurn, is_wanted) || stop_) continue;
    jobs_seen = jobs_;
    ++at_work_;
    lock.unlock();
    take_parts(index + 1, &helper);
    tell(helper);
    lock.lock();
    if (--at_work_ == 0) end_.notify_one();
  }
}

void Workers::tell(Helper& helper) {
  helper.cpu_time.store(thread_cpu_time().count(), std::memory_order_relaxed);
  helper.page_faults.store(thread_page_faults(), std::memory_order_relaxed);
}

Duration Workers::helpers_cpu_time() const {
  Duration sum{};
  for (const auto& helper : helpers_)
    sum += Duration(helper->cpu_time.load(std::memory_order_relaxed));
  return sum;
}

std::uint64_t Workers::helpers_page_faults() const {
  std::uint64_t sum = 0;
  for (const auto& helper : helpers_) sum += helper->page_faults.load(std::memory_order_relaxed);
  return sum;
}

std::size_t suitable_workers(int wanted, bool has_stereo) {
  if (wanted > 0) return static_cast<std::size_t>(wanted);
  return has_stereo && usable_cpus() > 1 ? 2 : 1;
}

}  // namespace wagonsight
