#include "linux/resources.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <time.h>  // NOLINT(modernize-deprecated-headers): POSIX clocks
#include <unistd.h>

#include <array>
#include <charconv>
#include <string_view>

#include "base/check.h"

namespace wagonsight {
namespace {

Duration cpu_clock(clockid_t clock) {
  timespec used{};
  WS_CHECK(clock_gettime(clock, &used) == 0, "clock %d", clock);
  return std::chrono::seconds(used.tv_sec) + Duration(used.tv_nsec);
}

}  // namespace

std::uint64_t resident_bytes() {
  // "size resident shared ..." in pages.
  const int fd = ::open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  if (fd < 0) return 0;
  std::array<char, 128> line{};
  const ssize_t got = ::read(fd, line.data(), line.size());
  ::close(fd);
  std::string_view text(line.data(), got > 0 ? static_cast<std::size_t>(got) : 0);
  const std::size_t space = text.find(' ');
  if (space == std::string_view::npos) return 0;
  text.remove_prefix(space + 1);
  std::uint64_t pages = 0;
  std::from_chars(text.data(), text.data() + text.size(), pages);
  return pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

std::uint64_t resident_bytes_peak() {
  rusage usage{};
  WS_CHECK(getrusage(RUSAGE_SELF, &usage) == 0, "getrusage");
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

Duration process_cpu_time() {
  return cpu_clock(CLOCK_PROCESS_CPUTIME_ID);
}

Duration thread_cpu_time() {
  return cpu_clock(CLOCK_THREAD_CPUTIME_ID);
}

}  // namespace wagonsight
