#include "updater_link.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstring>

namespace wagonsight {
namespace {

// A disk may take long, but the daemon ends a web side that is silent for three seconds.
constexpr timeval kPatience{2, 0};
constexpr const char* kLost =
    "{\"error\":\"The updater does not answer just now; try again in a few seconds.\"}\n";

}  // namespace

UpdaterLink::UpdaterLink(int fd) : fd_(fcntl(fd, F_GETFD) >= 0 ? fd : -1) {
  if (fd_ < 0) return;
  setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &kPatience, sizeof kPatience);
  setsockopt(fd_, SOL_SOCKET, SO_SNDTIMEO, &kPatience, sizeof kPatience);
}

std::optional<UpdaterLink::Told> UpdaterLink::ask(const UpdaterCall& call, std::string_view block) {
  if (fd_ < 0) return std::nullopt;
  if (is_lost_) return Told{503, kLost};
  UpdaterCall head = call;
  std::array<iovec, 2> parts = {iovec{&head, sizeof head},
                                iovec{const_cast<char*>(block.data()), block.size()}};
  msghdr message{};
  message.msg_iov = parts.data();
  message.msg_iovlen = parts.size();
  const auto size = static_cast<ssize_t>(sizeof head + block.size());
  std::string answer(sizeof(UpdaterAnswer) + kUpdaterAnswerBytesMax, '\0');
  const bool sent = sendmsg(fd_, &message, MSG_NOSIGNAL) == size;
  const ssize_t got = sent ? recv(fd_, answer.data(), answer.size(), 0) : -1;
  if (got < static_cast<ssize_t>(sizeof(UpdaterAnswer))) {
    is_lost_ = true;
    return Told{503, kLost};
  }
  UpdaterAnswer told;
  std::memcpy(&told, answer.data(), sizeof told);
  return Told{told.status, answer.substr(sizeof told, static_cast<std::size_t>(got) - sizeof told)};
}

int connect_updater(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof address.sun_path) return -1;
  std::memcpy(address.sun_path, path.c_str(), path.size());
  const int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
  if (fd >= 0 && connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    close(fd);
    return -1;
  }
  return fd;
}

}  // namespace wagonsight
