#include "virtual_time.h"

#include <algorithm>

#include "base/check.h"

namespace wagonsight::device {

VirtualTime& VirtualTime::instance() {
  static VirtualTime time;
  return time;
}

VirtualTime::Waiter*& VirtualTime::own_waiter() {
  thread_local Waiter* waiter = nullptr;
  return waiter;
}

bool VirtualTime::this_thread_acts() {
  return own_waiter() != nullptr;
}

VirtualTime::Actor::Actor() {
  VirtualTime& time = instance();
  WS_CHECK(!this_thread_acts(), "an actor twice in %s", "one thread");
  own_waiter() = new Waiter;
  const std::lock_guard hold(time.mutex_);
  time.join(*own_waiter());
}

VirtualTime::Actor::~Actor() {
  VirtualTime& time = instance();
  {
    const std::lock_guard hold(time.mutex_);
    time.leave(*own_waiter());
  }
  delete own_waiter();
  own_waiter() = nullptr;
}

VirtualTime::Absence::Absence() {
  const std::lock_guard hold(instance().mutex_);
  if (this_thread_acts()) instance().leave(*own_waiter());
}

VirtualTime::Absence::~Absence() {
  const std::lock_guard hold(instance().mutex_);
  if (this_thread_acts()) instance().join(*own_waiter());
}

void VirtualTime::join(Waiter& waiter) {
  actors_.push_back(&waiter);
  ++running_;
}

void VirtualTime::leave(Waiter& waiter) {
  actors_.remove(&waiter);
  --running_;
  advance_when_all_wait();
}

void VirtualTime::wait(Lock& lock, Nanoseconds deadline, const std::function<bool()>& ready,
                       const std::function<Nanoseconds()>& next) {
  Waiter& self = *own_waiter();
  while (!ready() && now_ < deadline) {
    self.wake_at = std::max(std::min(deadline, next()), now_ + 1);
    self.is_waiting = true;
    --running_;
    advance_when_all_wait();
    self.woken.wait(lock, [&] { return !self.is_waiting; });
  }
}

void VirtualTime::sleep_until(Nanoseconds deadline) {
  Lock lock(mutex_);
  wait(
      lock, deadline, [] { return false; }, [] { return kNever; });
}

void VirtualTime::something_changed() {
  for (Waiter* actor : actors_) {
    if (!actor->is_waiting) continue;
    actor->is_waiting = false;
    ++running_;
    actor->woken.notify_one();
  }
}

void VirtualTime::at(Nanoseconds when, std::function<void()> deed) {
  script_.emplace(when, std::move(deed));
}

void VirtualTime::forget_script() {
  const std::lock_guard hold(mutex_);
  script_.clear();
}

void VirtualTime::advance_when_all_wait() {
  while (running_ == 0 && !actors_.empty()) {
    Nanoseconds earliest = kNever;
    for (const Waiter* actor : actors_) earliest = std::min(earliest, actor->wake_at);
    if (!script_.empty() && script_.begin()->first <= earliest) {
      now_ = std::max(now_, script_.begin()->first);
      const auto deed = std::move(script_.begin()->second);
      script_.erase(script_.begin());
      deed();
      continue;
    }
    WS_CHECK(earliest != kNever, "all %zu actors wait for ever", actors_.size());
    now_ = std::max(now_, earliest);
    for (Waiter* actor : actors_) {
      if (actor->wake_at > now_) continue;
      actor->is_waiting = false;
      ++running_;
      actor->woken.notify_one();
    }
  }
}

}  // namespace wagonsight::device
