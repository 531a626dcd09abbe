#include "loopback_http.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>

namespace wagonsight {
namespace {

constexpr timeval kTimeout{2, 0};
constexpr timeval kUnitTimeout{10, 0};  // a block may have to wait for the unit's disk
constexpr std::size_t kAnswerMax = std::size_t{4} << 20;

class Connection {
 public:
  explicit Connection(const timeval& patience)
      : descriptor_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)), patience_(patience) {}
  ~Connection() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  bool open(std::uint32_t host, std::uint16_t port) {
    if (descriptor_ < 0) return false;
    ::setsockopt(descriptor_, SOL_SOCKET, SO_RCVTIMEO, &patience_, sizeof patience_);
    ::setsockopt(descriptor_, SOL_SOCKET, SO_SNDTIMEO, &patience_, sizeof patience_);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = host;
    return ::connect(descriptor_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  }
  bool send(std::string_view text) {
    while (!text.empty()) {
      const ssize_t sent = ::send(descriptor_, text.data(), text.size(), MSG_NOSIGNAL);
      if (sent <= 0) return false;
      text.remove_prefix(static_cast<std::size_t>(sent));
    }
    return true;
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
  timeval patience_;
};

}  // namespace

Result<std::string> get_from_loopback(std::uint16_t port, const std::string& path) {
  const std::string where = fmt::format("127.0.0.1:{}", port);
  Connection connection(kTimeout);
  if (!connection.open(htonl(INADDR_LOOPBACK), port))
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

Result<UnitAddress> parse_unit_address(std::string_view text) {
  UnitAddress address;
  address.text = text;
  const std::size_t colon = text.find(':');
  const std::string host(text.substr(0, colon));
  in_addr number{};
  bool is_good = inet_pton(AF_INET, host.c_str(), &number) == 1;
  if (colon != std::string_view::npos) {
    const std::string_view digits = text.substr(colon + 1);
    const auto read = std::from_chars(digits.data(), digits.data() + digits.size(), address.port);
    is_good = is_good && read.ec == std::errc{} && read.ptr == digits.data() + digits.size();
  }
  if (!is_good)
    return fail(fmt::format("{}: must be a numeric address, such as 10.1.2.3:8080", text));
  address.host = number.s_addr;
  return address;
}

Result<UnitAnswer> unit_request(const UnitAddress& to, std::string_view method,
                                std::string_view path, std::string_view token,
                                std::span<const std::byte> body) {
  Connection connection(kUnitTimeout);
  if (!connection.open(to.host, to.port))
    return fail(fmt::format("no unit answers at {} ({}); check its power and the network", to.text,
                            std::strerror(errno)));
  const std::string head = fmt::format(
      "{} {} HTTP/1.0\r\nHost: {}\r\nAuthorization: Bearer {}\r\nContent-Length: {}\r\n\r\n",
      method, path, to.text, token, body.size());
  std::string answer;
  if (!connection.send(head) ||
      !connection.send({reinterpret_cast<const char*>(body.data()), body.size()}) ||
      !connection.receive_all(answer))
    return fail(fmt::format("no answer from {}; check the network and try again", to.text));
  const std::size_t head_end = answer.find("\r\n\r\n"), space = answer.find(' ');
  UnitAnswer told;
  if (head_end != std::string::npos && space < head_end)
    std::from_chars(answer.data() + space + 1, answer.data() + head_end, told.status);
  if (told.status == 0)
    return fail(fmt::format("{} does not speak HTTP; give the unit's address", to.text));
  told.body = answer.substr(head_end + 4);
  return told;
}

}  // namespace wagonsight
