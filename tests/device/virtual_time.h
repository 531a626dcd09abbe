#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <limits>
#include <list>
#include <map>
#include <mutex>

namespace wagonsight::device {

// Time that passes only when nobody has anything to do, so that a busy machine can never lose a
// packet of an emulated device and a minute of bus traffic takes as long as its bytes need.
//
// Threads that live in this time are actors. While any actor runs, the clock stands still; when all
// of them wait, it jumps to the earliest instant one of them waits for. What is scripted with at()
// happens on the way, in the thread that moves the clock.
//
// One per process, because the system calls that follow it (kernel_seam) are. Its mutex also guards
// whatever is emulated.
class VirtualTime {
 public:
  using Nanoseconds = std::int64_t;
  static constexpr Nanoseconds kNever = std::numeric_limits<Nanoseconds>::max();

  static VirtualTime& instance();

  // Makes the calling thread an actor while it lives.
  class Actor {
   public:
    Actor();
    ~Actor();
    Actor(const Actor&) = delete;
    Actor& operator=(const Actor&) = delete;
  };
  static bool this_thread_acts();

  // While it lives the calling actor counts as waiting: for what has nothing to do with time, as
  // another thread's end.
  class Absence {
   public:
    Absence();
    ~Absence();
    Absence(const Absence&) = delete;
    Absence& operator=(const Absence&) = delete;
  };

  std::mutex& mutex() { return mutex_; }
  // With or without the mutex: it changes only while every actor waits.
  Nanoseconds now() const { return now_; }

  // Actors only, with the mutex held: returns when `ready` says so or at `deadline`. `next` is when
  // the passing of time alone may make it ready. Both are called with the mutex held.
  using Lock = std::unique_lock<std::mutex>;
  void wait(Lock& lock, Nanoseconds deadline, const std::function<bool()>& ready,
            const std::function<Nanoseconds()>& next);
  void sleep_until(Nanoseconds deadline);

  // With the mutex held: whoever waits looks again.
  void something_changed();
  // Calls `deed` at `when`, with the mutex held.
  void at(Nanoseconds when, std::function<void()> deed);
  // Forgets what was scripted. Between tests.
  void forget_script();

 private:
  struct Waiter {
    std::condition_variable woken;
    Nanoseconds wake_at = kNever;
    bool is_waiting = false;
  };
  static Waiter*& own_waiter();

  void join(Waiter& waiter);
  void leave(Waiter& waiter);
  void advance_when_all_wait();

  std::mutex mutex_;
  Nanoseconds now_ = 1'000'000'000'000;
  std::list<Waiter*> actors_;
  std::size_t running_ = 0;
  std::multimap<Nanoseconds, std::function<void()>> script_;
};
using Nanoseconds = VirtualTime::Nanoseconds;

}  // namespace wagonsight::device
