// The hand of the campaign inside the machine. The image that is put to the test is the shipped
// one, which has no login; so the campaign hands the loader a second initramfs, in which this is
// the first program. It leaves a child behind that lives below the unit's root, and becomes the
// shipped first program. The child obeys lines on the second serial line:
//   kill N     after N milliseconds SIGKILL for wagonsightd itself; waits until another one answers
//                -> killed PID, started again after A ms, its web side after B ms, back after N ms
//   ready      waits until /readyz says so         -> ready after N ms
//   forget     removes the note of past crashes    -> forgotten
//   resident   names and resident kB of every process, and the machine's memory; ends with "."
//   flood N    N lines of 200 bytes to the log     -> flooded, and the log's shared memory in bytes
#include <arpa/inet.h>
#include <dirent.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/mount.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/un.h>
#include <termios.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <thread>

namespace {

const std::string kProc = "/drill/proc/", kDev = "/drill/dev/";

struct Process {
  int pid = 0, parent = 0;
  std::string name;
  std::string resident_kb;
};

void for_each_process(const std::function<void(const Process&)>& visit) {
  DIR* folder = opendir(kProc.c_str());
  if (folder == nullptr) return;
  while (const dirent* entry = readdir(folder)) {
    Process process;
    process.pid = std::atoi(entry->d_name);
    if (process.pid <= 0) continue;
    std::ifstream status(kProc + entry->d_name + "/status");
    for (std::string line; std::getline(status, line);) {
      std::istringstream words(line);
      std::string key, value;
      words >> key >> value;
      if (key == "Name:") process.name = value;
      if (key == "PPid:") process.parent = std::atoi(value.c_str());
      if (key == "VmRSS:") process.resident_kb = value;
    }
    visit(process);
  }
  closedir(folder);
}

using Clock = std::chrono::steady_clock;

long long milliseconds_since(Clock::time_point begin) {
  return std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - begin).count();
}

void pause_ms(int milliseconds) {
  std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
}

// The daemon, which init started.
int find_daemon() {
  int daemon = 0;
  for_each_process([&](const Process& process) {
    if (process.name == "wagonsightd" && process.parent == 1) daemon = process.pid;
  });
  return daemon;
}

// The daemon's web side; it has another name.
bool has_child(int parent) {
  bool found = false;
  for_each_process([&](const Process& process) { found = found || process.parent == parent; });
  return found;
}

bool answers_200(const std::string& path) {
  const int fd = socket(AF_INET, SOCK_STREAM, 0);
  const timeval patience{2, 0};
  setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(8080);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string answer(12, ' ');
  const std::string request =
      "GET " + path + " HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n";
  const bool is_good = connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0 &&
                       send(fd, request.data(), request.size(), MSG_NOSIGNAL) > 0 &&
                       recv(fd, answer.data(), answer.size(), MSG_WAITALL) > 0 &&
                       answer == "HTTP/1.1 200";
  close(fd);
  return is_good;
}

std::string wait_for(const std::string& path, const std::string& what, Clock::time_point begin) {
  while (!answers_200(path)) {
    if (milliseconds_since(begin) > 60'000) return "nobody answers within a minute\n";
    pause_ms(20);
  }
  return what + std::to_string(milliseconds_since(begin)) + " ms\n";
}

std::string kill_daemon(int after_ms) {
  pause_ms(after_ms);
  const int pid = find_daemon();
  const auto begin = Clock::now();
  if (pid == 0 || kill(pid, SIGKILL) != 0) return "there is no daemon\n";
  int other = pid;
  for (; other == pid || other == 0; other = find_daemon()) {
    if (milliseconds_since(begin) > 60'000) return "not started again within a minute\n";
    pause_ms(20);
  }
  const auto started = milliseconds_since(begin);
  while (!has_child(other) && milliseconds_since(begin) < 60'000) pause_ms(20);
  const auto spawned = milliseconds_since(begin);
  return wait_for("/livez",
                  "killed " + std::to_string(pid) + ", started again after " +
                      std::to_string(started) + " ms, its web side after " +
                      std::to_string(spawned) + " ms, back after ",
                  begin);
}

std::string tell_resident() {
  std::string told;
  for_each_process([&](const Process& process) {
    if (!process.resident_kb.empty())
      told += "resident " + process.name + " " + std::to_string(process.pid) + " " +
              process.resident_kb + "\n";
  });
  std::ifstream memory(kProc + "meminfo");
  for (std::string line; std::getline(memory, line);)
    if (line.starts_with("Mem") || line.starts_with("Shmem:")) told += line + "\n";
  return told + ".\n";
}

std::string flood(int lines) {
  const std::string path = kProc + "1/root/dev/log";
  const int fd = socket(AF_UNIX, SOCK_DGRAM, 0);
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  path.copy(to.sun_path, sizeof to.sun_path - 1);
  if (connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) return "no log\n";
  for (int i = 0; i < lines; ++i) {
    std::string line = "<14>drill: line " + std::to_string(i) + " ";
    line.resize(200, 'x');
    if (send(fd, line.data(), line.size(), 0) < 0) return "the log is gone\n";
  }
  close(fd);
  std::ifstream segments(kProc + "sysvipc/shm");
  std::string told = "flooded", line;
  std::getline(segments, line);  // the head
  while (std::getline(segments, line)) {
    std::istringstream words(line);
    std::string key, id, permissions, size;
    words >> key >> id >> permissions >> size;
    told += " " + size;
  }
  return told + "\n";
}

std::string obey(const std::string& command) {
  if (command.starts_with("kill ")) return kill_daemon(std::atoi(command.c_str() + 5));
  if (command == "ready") return wait_for("/readyz", "ready after ", Clock::now());
  if (command == "forget")
    return unlink((kProc + "1/root/run/wagonsight/run-record").c_str()) == 0 ? "forgotten\n"
                                                                             : "nothing noted\n";
  if (command == "resident") return tell_resident();
  if (command.starts_with("flood ")) return flood(std::atoi(command.c_str() + 6));
  return "what? " + command + "\n";
}

// On the console.
void say(const char* text) {
  const int fd = open((kDev + "kmsg").c_str(), O_WRONLY);
  const std::string line = std::string("<1>drill: ") + text;
  if (write(fd, line.data(), line.size()) < 0) perror("drill");
  close(fd);
}

void obey_the_line() {
  mkdir("/drill", 0700);
  mkdir(kProc.c_str(), 0700);
  mkdir(kDev.c_str(), 0700);
  mount("proc", kProc.c_str(), "proc", 0, nullptr);
  mount("dev", kDev.c_str(), "devtmpfs", 0, nullptr);
  const int line = open((kDev + "ttyS1").c_str(), O_RDWR | O_NOCTTY);
  say(line < 0 ? "there is no second serial line" : "listens");
  if (line < 0) return;
  termios settings{};
  tcgetattr(line, &settings);
  cfmakeraw(&settings);
  tcsetattr(line, TCSANOW, &settings);
  std::string command;
  for (char c = 0; read(line, &c, 1) == 1;) {
    if (c != '\n') {
      command += c;
      continue;
    }
    const std::string answer = obey(command);
    for (std::size_t done = 0; done < answer.size();) {
      const ssize_t wrote = write(line, answer.data() + done, answer.size() - done);
      if (wrote <= 0) return;
      done += static_cast<std::size_t>(wrote);
    }
    command.clear();
  }
}

}  // namespace

int main() {
  if (fork() == 0) {
    setsid();
    obey_the_line();
    return 0;
  }
  execl("/bin/sh", "sh", "/init.shipped", nullptr);
  return 1;
}
