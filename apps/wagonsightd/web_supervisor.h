#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "base/result.h"
#include "status/http.h"
#include "web_side.h"

namespace wagonsight {

// Keeps the web side alive: starts it, and starts it anew when it ended or when its loop stopped
// turning. One thread uses it, and must live as long as the process: the web side dies with it.
//
//      start()            ended, or silent for kSilenceMaxS (then killed)
//   idle ----> running --------------------------------------------------> waiting
//                 ^                     the pause is over                     |
//                 +-----------------------------------------------------------+
class WebSupervisor {
 public:
  // Says what happened, for the log. A sentence.
  using Tell = std::function<void(std::string_view)>;

  // Does what the web side was asked for by somebody who may. The web side is not trusted: whoever
  // obeys bounds what it may do.
  using Obey = std::function<void(const UnitCommand&)>;

  // The descriptors stay the caller's and must outlive the supervisor. `updater`: the path of its
  // socket; where nobody listens, the web side is without one.
  WebSupervisor(int block_fd, int listening_fd, const AccessRules& access, Tell tell,
                Obey obey = {}, std::string updater = {});
  ~WebSupervisor();  // ends the web side
  WebSupervisor(const WebSupervisor&) = delete;
  WebSupervisor& operator=(const WebSupervisor&) = delete;

  Result<void> start(double now_s);
  // To be called a few times a second with the monotonic clock. Never blocks.
  void tick(double now_s);

  int pid() const { return pid_; }
  std::uint32_t restarts() const { return restarts_; }

  static constexpr double kSilenceMaxS = 3.0;  // six heartbeats

 private:
  void hear(double now_s);
  void reap(double now_s);
  void look_for_updater(double now_s);
  void close_link();

  int block_fd_, listening_fd_;
  WebGreeting greeting_;
  Tell tell_;
  Obey obey_;
  std::string updater_;
  std::array<std::byte, sizeof(WebMessage)> message_{};  // as far as it has come
  std::size_t message_size_ = 0;
  int pid_ = -1;
  int link_fd_ = -1;
  bool killed_ = false;
  bool has_updater_ = false;
  double look_again_s_ = 0;
  double started_s_ = 0, heard_s_ = 0;
  double start_again_s_ = 0, pause_s_ = 0;
  std::uint32_t restarts_ = 0;
};

}  // namespace wagonsight
