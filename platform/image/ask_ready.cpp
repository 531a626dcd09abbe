// ask-ready [PORT]: exits with 0 when the unit's /readyz answers 200. (busybox's wget cannot be
// used: it resolves even numeric addresses through shared libraries that the image does not have.)
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <string_view>

int main(int argc, char** argv) {
  const int port = argc > 1 ? std::atoi(argv[1]) : 8080;
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const timeval patience{4, 0};
  setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(port));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) return 1;
  constexpr std::string_view kRequest =
      "GET /readyz HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n";
  constexpr std::string_view kGood = "HTTP/1.1 200";
  if (send(fd, kRequest.data(), kRequest.size(), MSG_NOSIGNAL) < 0) return 1;
  std::array<char, kGood.size()> answer{};
  const ssize_t got = recv(fd, answer.data(), answer.size(), MSG_WAITALL);
  return got == static_cast<ssize_t>(kGood.size()) &&
                 std::string_view(answer.data(), answer.size()) == kGood
             ? 0
             : 1;
}
