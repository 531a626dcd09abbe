#pragma once

#include <arpa/inet.h>
#include <fcntl.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <string>
#include <thread>
#include <vector>

namespace wagonsight::testing {

// wagonsightd on a free port of the loopback, until the object goes. port() is 0 when it did not
// come up.
class RunningDaemon {
 public:
  explicit RunningDaemon(const std::string& config) {
    int out[2];
    if (pipe2(out, O_CLOEXEC) != 0) return;
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, out[1], STDOUT_FILENO);
    std::vector<std::string> words{WAGONSIGHTD_PROGRAM, "--config", config, "--port", "0"};
    std::vector<char*> argv;
    argv.reserve(words.size() + 1);
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    posix_spawn(&pid_, WAGONSIGHTD_PROGRAM, &actions, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    close(out[1]);
    std::string line;
    for (char c = 0; read(out[0], &c, 1) == 1 && c != '\n';) line += c;
    out_ = out[0];  // stays open: whatever it says later has somewhere to go
    const std::string address = "http://127.0.0.1:";
    if (line.rfind(address, 0) == 0)
      port_ = static_cast<std::uint16_t>(std::stoi(line.substr(address.size())));
    wait_for_web_side();
  }
  ~RunningDaemon() {
    if (pid_ <= 0) return;
    kill(pid_, SIGTERM);
    waitpid(pid_, nullptr, 0);
    close(out_);
  }
  RunningDaemon(const RunningDaemon&) = delete;
  RunningDaemon& operator=(const RunningDaemon&) = delete;

  std::uint16_t port() const { return port_; }

  // The whole answer to these bytes; empty when there is none.
  std::string ask(const std::string& request) const {
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const timeval patience{5, 0};
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port_);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    std::string answer;
    if (connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0) {
      (void)send(fd, request.data(), request.size(), MSG_NOSIGNAL);
      char part[4096];
      for (ssize_t size = 0; (size = recv(fd, part, sizeof part, 0)) > 0;)
        answer.append(part, static_cast<std::size_t>(size));
    }
    close(fd);
    return answer;
  }
  std::string get(const std::string& path) const {
    return ask("GET " + path + " HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n");
  }

 private:
  void wait_for_web_side() const {
    for (int i = 0; i < 3000 && port_ != 0; ++i) {  // a minute
      // Until frames were worked on, the unit says that it knows nothing yet.
      if (get("/api/v1/sensors").rfind("HTTP/1.1 200", 0) == 0) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }

  pid_t pid_ = -1;
  int out_ = -1;
  std::uint16_t port_ = 0;
};

}  // namespace wagonsight::testing
