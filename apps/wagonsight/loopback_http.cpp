#include "loopback_http.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace wagonsight {
namespace {

constexpr timeval kTimeout{2, 0};
constexpr std::size_t kAnswerMax = std::size_t{4} << 20;

class Connection {
 public:
  Connection() : descriptor_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {}
  ~Connection() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  bool open(std::uint16_t port) {
    if (descriptor_ < 0) return false;
    ::setsockopt(descriptor_, SOL_SOCKET, SO_RCVTIMEO, &kTimeout, sizeof kTimeout);
    ::setsockopt(descriptor_, SOL_SOCKET, SO_SNDTIMEO, &kTimeout, sizeof kTimeout);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return ::connect(descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  }
  bool send(const std::string& text) {
    return ::send(descriptor_, text.data(), text.size(), MSG_NOSIGNAL) ==
           static_cast<ssize_t>(text.size());
  }
  // To the end of the answer; false when it does not come.
  bool receive_all(std::string& text) {
    std::array<char, 16'384> part{};
    while (text.size() < kAnswerMax) {
      const ssize_t got = ::recv(descriptor_, part.data(), part.size(), 0);
      if (got == 0) return true;
      if (got < 0) return false;
      text.append(part.data(), static_cast<std::size_t>(got));
    }
    return false;
  }

 private:
  int descriptor_;
};

}  // namespace

Result<std::string> get_from_loopback(std::uint16_t port, const std::string& path) {
  const std::string where = fmt::format("127.0.0.1:{}", port);
  Connection connection;
  if (!connection.open(port))
    return fail(
        fmt::format("no wagonsightd answers at {} ({}); start it, give its --port, or give "
                    "a diagnostics bundle",
                    where, std::strerror(errno)));
  // HTTP/1.0: the answer ends with the connection and comes in one piece.
  std::string answer;
  if (!connection.send(fmt::format("GET {} HTTP/1.0\r\nHost: {}\r\n\r\n", path, where)) ||
      !connection.receive_all(answer))
    return fail(
        fmt::format("{} took the question and gave no answer within two seconds; restart "
                    "wagonsightd and look into its log",
                    where));
  const std::size_t head_end = answer.find("\r\n\r\n");
  const std::string status = answer.substr(0, answer.find("\r\n"));
  const bool is_told =
      status.find(" 200") != std::string::npos || status.find(" 503") != std::string::npos;
  if (head_end == std::string::npos || !is_told)
    return fail(fmt::format("{} is no wagonsightd: it answered \"{}\"; give the right --port",
                            where, status.substr(0, 80)));
  return answer.substr(head_end + 4);
}

}  // namespace wagonsight
