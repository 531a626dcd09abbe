#include "slots/run_program.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>

namespace wagonsight {
namespace {

constexpr std::size_t kWordsMax = 2000;

// What comes until the other end is closed; only the beginning is kept.
std::string hear(int fd) {
  std::string words;
  std::array<char, 512> piece{};
  while (true) {
    const ssize_t got = read(fd, piece.data(), piece.size());
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) break;
    if (words.size() < kWordsMax) words.append(piece.data(), static_cast<std::size_t>(got));
  }
  while (!words.empty() && words.back() == '\n') words.pop_back();
  return words;
}

}  // namespace

Result<void> run_program(const std::vector<std::string>& argv) {
  std::array<int, 2> pipe{};
  if (pipe2(pipe.data(), O_CLOEXEC) != 0)
    return fail(fmt::format("{}: pipe: {}", argv[0], std::strerror(errno)));
  std::vector<char*> words;
  words.reserve(argv.size() + 1);
  for (const std::string& word : argv) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  posix_spawn_file_actions_t actions{};
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, pipe[1], STDERR_FILENO);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  // Who waits for signals as values has them blocked, and ignores SIGPIPE; the program shall not.
  posix_spawnattr_t attributes{};
  posix_spawnattr_init(&attributes);
  sigset_t none{}, all{};
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  pid_t pid = -1;
  const int error = posix_spawnp(&pid, words[0], &actions, &attributes, words.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  close(pipe[1]);
  const std::string said = error == 0 ? hear(pipe[0]) : std::string();
  close(pipe[0]);
  if (error != 0) return fail(fmt::format("{}: cannot be run: {}", argv[0], std::strerror(error)));
  int status = 0;
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return {};
  return fail(said.empty() ? fmt::format("{} failed and said nothing", argv[0]) : said);
}

}  // namespace wagonsight
