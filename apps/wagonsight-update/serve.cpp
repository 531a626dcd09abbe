#include "serve.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "linux/stop_signals.h"
#include "slots/run_program.h"

namespace wagonsight {
namespace {

constexpr std::size_t kCallersMax = 4;  // the page's process, and one that is about to go
constexpr Duration kPeriod = std::chrono::milliseconds(1);
constexpr int kPollMs = 200;

tl::unexpected<Error> failed(const std::string& socket, const char* what) {
  return fail(fmt::format("{}: {}: {}", socket, what, std::strerror(errno)));
}

Result<int> listen_at(const std::string& path, int group) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path)
    return fail(fmt::format("{}: is too long for a socket's path", path));
  std::memcpy(address.sun_path, path.c_str(), path.size());
  const int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return failed(path, "cannot be made");
  unlink(path.c_str());
  const mode_t old = umask(0177);
  const bool bound = bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  umask(old);
  const bool open = bound &&
                    (group < 0 || chown(path.c_str(), 0, static_cast<gid_t>(group)) == 0) &&
                    chmod(path.c_str(), 0660) == 0 && listen(fd, kCallersMax) == 0;
  if (!open) {
    const auto error = failed(path, "cannot be listened at");
    close(fd);
    return error;
  }
  return fd;
}

class Server {
 public:
  Server(Updater& updater, int listening, const std::vector<std::string>& restart)
      : updater_(updater),
        restart_(restart),
        listening_(listening),
        buffer_(sizeof(UpdaterCall) + kUpdaterBlockBytesMax) {}
  ~Server() {
    for (const int caller : callers_) close(caller);
    close(listening_);
  }
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  void turn() {
    std::vector<pollfd> wanted = {{listening_, POLLIN, 0}};
    for (const int caller : callers_) wanted.push_back({caller, POLLIN, 0});
    if (poll(wanted.data(), wanted.size(), kPollMs) <= 0) return;
    for (std::size_t i = 1; i < wanted.size(); ++i)
      if (wanted[i].revents != 0 && !answer(wanted[i].fd)) hang_up(wanted[i].fd);
    if (wanted[0].revents != 0) take();
  }

 private:
  void take() {
    const int caller = accept4(listening_, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (caller < 0) return;
    // The oldest is the one whose process went without being noticed.
    if (callers_.size() == kCallersMax) hang_up(callers_.front());
    callers_.push_back(caller);
  }
  void hang_up(int caller) {
    close(caller);
    callers_.erase(std::remove(callers_.begin(), callers_.end(), caller), callers_.end());
  }

  // False when the caller went, or does not speak as it should.
  bool answer(int caller) {
    const ssize_t size = recv(caller, buffer_.data(), buffer_.size(), MSG_TRUNC);
    if (size < 0) return errno == EAGAIN || errno == EINTR;
    const auto got = static_cast<std::size_t>(size);
    if (got < sizeof(UpdaterCall) || got > buffer_.size()) return false;
    UpdaterCall call;
    std::memcpy(&call, buffer_.data(), sizeof call);
    if (call.wish > UpdaterWish::kFactoryReset) return false;
    const UpdaterReply reply =
        updater_.call(call, std::span(buffer_).subspan(sizeof call, got - sizeof call));
    const UpdaterAnswer head{reply.status};
    std::string message(sizeof head, '\0');
    std::memcpy(message.data(), &head, sizeof head);
    message += reply.json;
    const bool told = send(caller, message.data(), message.size(), MSG_NOSIGNAL) ==
                      static_cast<ssize_t>(message.size());
    if (reply.restart && !restart_.empty())
      if (const auto done = run_program(restart_); !done)
        fmt::print(stderr, "wagonsight-update: restart: {}\n", done.error().message);
    return told;
  }

  Updater& updater_;
  const std::vector<std::string>& restart_;
  int listening_;
  std::vector<std::byte> buffer_;
  std::vector<int> callers_;
};

}  // namespace

Result<void> serve(Updater& updater, const std::string& socket, int group,
                   const std::vector<std::string>& restart) {
  const StopSignals signals;  // before any thread
  const auto listening = listen_at(socket, group);
  if (!listening) return tl::unexpected(listening.error());
  Server server(updater, *listening, restart);
  updater.resume();
  while (!signals.wait(kPeriod)) server.turn();
  unlink(socket.c_str());
  return {};
}

}  // namespace wagonsight
