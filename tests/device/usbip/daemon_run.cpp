#include "daemon_run.h"

#include <arpa/inet.h>
#include <grp.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>

namespace wagonsight::device::usbip {
namespace {

constexpr uid_t kUser = 100;  // platform/image/root/run-daemon's
constexpr timeval kPatience{5, 0};

[[noreturn]] void become(const std::string& program, const std::string& settings,
                         const std::string& state_folder) {
  const bool is_user = setgroups(0, nullptr) == 0 && setgid(kUser) == 0 && setuid(kUser) == 0;
  const std::string port = std::to_string(DaemonRun::kPort);
  if (is_user)
    execl(program.c_str(), program.c_str(), "--config", settings.c_str(), "--port", port.c_str(),
          "--state", state_folder.c_str(), nullptr);
  _exit(127);
}

std::string exchange(const std::string& request) {
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &kPatience, sizeof kPatience);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(DaemonRun::kPort);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string answer;
  if (connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0 &&
      send(fd, request.data(), request.size(), MSG_NOSIGNAL) > 0) {
    char block[4096];
    for (ssize_t count = 0; (count = recv(fd, block, sizeof block, 0)) > 0;)
      answer.append(block, static_cast<std::size_t>(count));
  }
  close(fd);
  return answer;
}

}  // namespace

Result<DaemonRun> DaemonRun::start(const std::string& program, const std::string& settings,
                                   const std::string& state_folder) {
  const pid_t pid = fork();
  if (pid < 0) return fail(program + ": " + std::strerror(errno));
  if (pid == 0) become(program, settings, state_folder);
  return DaemonRun(pid);
}

DaemonRun::~DaemonRun() {
  if (pid_ == 0) return;
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

DaemonRun::Answer DaemonRun::ask(const std::string& method, const std::string& path,
                                 const std::string& token) const {
  const std::string text = exchange(method + " " + path +
                                    " HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n"
                                    "Content-Length: 0\r\nAuthorization: Bearer " +
                                    token + "\r\n\r\n");
  constexpr std::size_t kStatusAt = sizeof "HTTP/1.1";
  if (text.size() < kStatusAt + 3) return {};
  Answer answer;
  answer.status = std::atoi(text.c_str() + kStatusAt);
  const std::size_t body = text.find("\r\n\r\n");
  if (body != std::string::npos)
    answer.body = nlohmann::json::parse(text.substr(body + 4), nullptr, false);
  return answer;
}

int DaemonRun::stop() {
  int status = 0;
  kill(pid_, SIGTERM);
  waitpid(pid_, &status, 0);
  pid_ = 0;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

}  // namespace wagonsight::device::usbip
