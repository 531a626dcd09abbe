#include "web_supervisor.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>

#include "updater_link.h"

namespace wagonsight {
namespace {

constexpr double kPauseFirstS = 0.1;
constexpr double kPauseLastS = 5.0;
constexpr double kUpdaterPeriodS = 3.0;
constexpr double kSettledS = 30.0;  // after so long a new fault is a first one again

// Above the numbers that the web side expects, so that moving one there never overwrites another.
constexpr int kSafeFd = 16;

int moved_up(int fd) {
  return fcntl(fd, F_DUPFD_CLOEXEC, kSafeFd);
}

// The child's attributes: no signal is blocked or ignored there.
class SpawnPlan {
 public:
  SpawnPlan() {
    posix_spawn_file_actions_init(&actions_);
    posix_spawnattr_init(&attributes_);
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes_, &none);
    posix_spawnattr_setsigdefault(&attributes_, &all);
    posix_spawnattr_setflags(&attributes_, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  }
  ~SpawnPlan() {
    posix_spawn_file_actions_destroy(&actions_);
    posix_spawnattr_destroy(&attributes_);
    for (const int fd : moved_)
      if (fd >= 0) close(fd);
  }
  SpawnPlan(const SpawnPlan&) = delete;
  SpawnPlan& operator=(const SpawnPlan&) = delete;

  void give(int fd, int as) {
    const int safe = moved_up(fd);
    moved_[count_++] = safe;
    posix_spawn_file_actions_adddup2(&actions_, safe, as);
  }
  int run(pid_t& pid) {
    char name[] = "wagonsightd";
    std::string argument = kWebSideArgument;
    std::array<char*, 3> arguments = {name, argument.data(), nullptr};
    return posix_spawn(&pid, "/proc/self/exe", &actions_, &attributes_, arguments.data(), environ);
  }

 private:
  posix_spawn_file_actions_t actions_{};
  posix_spawnattr_t attributes_{};
  std::array<int, 4> moved_{-1, -1, -1, -1};
  std::size_t count_ = 0;
};

std::string ending_text(int status) {
  if (WIFSIGNALED(status)) return fmt::format("was ended by signal {}", WTERMSIG(status));
  return fmt::format("ended with status {}", WEXITSTATUS(status));
}

}  // namespace

WebSupervisor::WebSupervisor(int block_fd, int listening_fd, const AccessRules& access, Tell tell,
                             Obey obey, std::string updater)
    : block_fd_(block_fd),
      listening_fd_(listening_fd),
      tell_(std::move(tell)),
      obey_(std::move(obey)),
      updater_(std::move(updater)) {
  greeting_.daemon_pid = getpid();
  greeting_.access = access;
}

WebSupervisor::~WebSupervisor() {
  close_link();
  if (pid_ > 0) {
    kill(pid_, SIGKILL);  // it holds nothing that would want to be put away
    waitpid(pid_, nullptr, 0);
  }
}

void WebSupervisor::close_link() {
  if (link_fd_ >= 0) close(link_fd_);
  link_fd_ = -1;
}

Result<void> WebSupervisor::start(double now_s) {
  std::array<int, 2> link{};
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, link.data()) != 0)
    return fail(fmt::format("web side: socketpair: {}", std::strerror(errno)));
  int error = 0;
  {
    SpawnPlan plan;
    plan.give(block_fd_, kWebBlockFd);
    plan.give(link[1], kWebLinkFd);
    plan.give(listening_fd_, kWebListenFd);
    const int updater = connect_updater(updater_);
    has_updater_ = updater >= 0;
    if (has_updater_) plan.give(updater, kWebUpdaterFd);
    error = plan.run(pid_);
    if (has_updater_) close(updater);
  }
  close(link[1]);
  link_fd_ = link[0];
  if (error != 0) {
    pid_ = -1;
    close_link();
    return fail(fmt::format("web side: could not be started: {}", std::strerror(error)));
  }
  fcntl(link_fd_, F_SETFL, O_NONBLOCK);
  // A new socket's buffer holds the greeting many times over, so this does not block.
  if (send(link_fd_, &greeting_, sizeof greeting_, MSG_NOSIGNAL) !=
      static_cast<ssize_t>(sizeof greeting_))
    tell_("The web side did not take its greeting.");
  killed_ = false;
  message_size_ = 0;
  started_s_ = heard_s_ = now_s;
  return {};
}

void WebSupervisor::hear(double now_s) {
  // A few messages a turn: who floods the link is not listened to for longer.
  for (int turn = 0; turn < 64; ++turn) {
    const ssize_t size = recv(link_fd_, message_.data() + message_size_,
                              message_.size() - message_size_, MSG_DONTWAIT);
    if (size <= 0) return;
    heard_s_ = now_s;
    message_size_ += static_cast<std::size_t>(size);
    if (message_size_ < message_.size()) continue;
    message_size_ = 0;
    WebMessage message;
    std::memcpy(&message, message_.data(), sizeof message);
    const auto kind = static_cast<UnitCommand::Kind>(message.kind);
    const bool is_known =
        kind == UnitCommand::Kind::kStartRecording || kind == UnitCommand::Kind::kStopRecording;
    if (is_known && obey_) obey_({kind, message.minutes});
  }
}

void WebSupervisor::reap(double now_s) {
  int status = 0;
  if (waitpid(pid_, &status, WNOHANG) != pid_) return;
  pid_ = -1;
  close_link();
  pause_s_ = now_s - started_s_ > kSettledS ? kPauseFirstS
                                            : std::clamp(2 * pause_s_, kPauseFirstS, kPauseLastS);
  start_again_s_ = now_s + pause_s_;
  tell_(fmt::format("The web side {} and is started again in {:.1f} s; no frame was lost by it.",
                    ending_text(status), pause_s_));
}

// A descriptor can only be given at the start.
void WebSupervisor::look_for_updater(double now_s) {
  if (updater_.empty() || has_updater_ || killed_ || now_s < look_again_s_) return;
  look_again_s_ = now_s + kUpdaterPeriodS;
  const int updater = connect_updater(updater_);
  if (updater < 0) return;
  close(updater);
  tell_("The updater is there; the web side is started anew with a link to it.");
  kill(pid_, SIGKILL);
  killed_ = true;
}

void WebSupervisor::tick(double now_s) {
  if (pid_ > 0) {
    hear(now_s);
    look_for_updater(now_s);
    if (now_s - heard_s_ > kSilenceMaxS && !killed_) {
      tell_("The web side stopped answering and is ended.");
      kill(pid_, SIGKILL);
      killed_ = true;
    }
    reap(now_s);
    return;
  }
  if (now_s < start_again_s_) return;
  ++restarts_;
  if (const auto started = start(now_s); !started) {
    tell_(started.error().message);
    pause_s_ = kPauseLastS;
    start_again_s_ = now_s + pause_s_;
  }
}

}  // namespace wagonsight
