#pragma once

#include <algorithm>

#include "base/time.h"

namespace wagonsight {

struct RecoveryOptions {
  Duration silent_after = std::chrono::milliseconds(500);
  Duration first_frame_within = std::chrono::seconds(2);  // after it was opened
  Duration healthy_after = std::chrono::seconds(5);       // of frames: past failures are forgotten
  Duration look_again = std::chrono::milliseconds(500);   // for a device that is not there
  Duration pause_first = std::chrono::milliseconds(100);  // after a failure; doubles with each
  Duration pause_max = std::chrono::seconds(30);
};

// When a driver opens its device, takes it for silent and tries again; what it does then is the
// driver's.
//
//                       no such device: look again in half a second
//                     .-----.
//                     v     |            streams
//     kClosed ---- open ----+-----> kStarting --- first frame ---> kStreaming
//        ^                              |                              |
//        '---- close, wait longer and longer ---- silent or unplugged -'
//
// One thread; never allocates; its decisions depend on the calls alone.
class Recovery {
 public:
  explicit Recovery(const RecoveryOptions& options = {})
      : options_(options), pause_(options.pause_first) {}

  bool is_closed() const { return phase_ == Phase::kClosed; }
  // When to try to open it, while it is closed.
  HostTime next_attempt() const { return next_attempt_; }
  // Of opening, or without a frame after it, since it was healthy.
  int failures() const { return failures_; }
  HostTime opened_at() const { return opened_; }

  void opened(HostTime now) {
    phase_ = Phase::kStarting;
    opened_ = last_frame_ = now;
  }
  void failed(HostTime now) {
    phase_ = Phase::kClosed;
    ++failures_;
    next_attempt_ = now + pause_;
    pause_ = std::min(2 * pause_, options_.pause_max);
  }
  void not_there(HostTime now) {
    phase_ = Phase::kClosed;
    next_attempt_ = now + options_.look_again;
  }
  // True for the first one after it was opened.
  bool frame(HostTime now) {
    last_frame_ = now;
    const bool is_first = phase_ == Phase::kStarting;
    phase_ = Phase::kStreaming;
    return is_first;
  }
  // Its stream ended, which is no failure of its own: open it again at once.
  void ended(HostTime now) {
    phase_ = Phase::kClosed;
    next_attempt_ = now;
  }
  // Whether it has been silent for too long; it is to be closed then, and counts as ended, or as
  // failed when it was not healthy before. Asked after each wait for its frames.
  bool is_silent(HostTime now) {
    const bool is_healthy = phase_ == Phase::kStreaming && now - opened_ > options_.healthy_after;
    const Duration patience =
        phase_ == Phase::kStarting ? options_.first_frame_within : options_.silent_after;
    if (now - last_frame_ > patience) {
      if (is_healthy)
        ended(now);
      else
        failed(now);
      return true;
    }
    if (is_healthy) {
      failures_ = 0;
      pause_ = options_.pause_first;
    }
    return false;
  }

 private:
  enum class Phase { kClosed, kStarting, kStreaming };

  RecoveryOptions options_;
  Phase phase_ = Phase::kClosed;
  HostTime next_attempt_{}, opened_{}, last_frame_{};
  int failures_ = 0;
  Duration pause_;
};

}  // namespace wagonsight
