#include "linux/held_memory.h"

#include <fmt/format.h>
#include <malloc.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <string_view>

#include "base/check.h"

#ifndef MADV_POPULATE_WRITE
#define MADV_POPULATE_READ 22  // Linux 5.14; the constants are younger than some C libraries
#define MADV_POPULATE_WRITE 23
#endif

namespace wagonsight {
namespace {

struct Mapping {
  std::uintptr_t begin = 0, end = 0;
  char rights[5] = {};

  std::size_t bytes() const { return end - begin; }
  bool private_and_writable() const {
    return rights[0] == 'r' && rights[1] == 'w' && rights[3] == 'p';
  }
};

// Kernels before 5.14 do not know how to populate: every page is written to with what it holds.
void touch(const Mapping& mapping) {
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  for (std::uintptr_t at = mapping.begin; at < mapping.end; at += page) {
    auto* byte = reinterpret_cast<volatile char*>(at);
    *byte = *byte;
  }
}

// Whether a line of /proc/self/maps ends with the program's own path.
bool is_of_program(std::string_view line) {
  char path[512];
  const ssize_t length = readlink("/proc/self/exe", path, sizeof path);
  if (length <= 0) return false;
  const std::string_view program(path, static_cast<std::size_t>(length));
  return line.ends_with(std::string(program) + "\n");
}

}  // namespace

Result<HeldMemory> hold_memory() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  return HeldMemory{};  // a sanitizer's shadow is a mapping of terabytes
#endif
  malloc_trim(0);
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> maps(std::fopen("/proc/self/maps", "re"),
                                                             std::fclose);
  if (!maps) return fail(fmt::format("/proc/self/maps: {}; mount /proc", std::strerror(errno)));
  HeldMemory held;
  char line[1024];
  while (std::fgets(line, sizeof line, maps.get()) != nullptr) {
    Mapping mapping;
    if (std::sscanf(line, "%lx-%lx %4s", &mapping.begin, &mapping.end, mapping.rights) != 3)
      continue;
    if (!mapping.private_and_writable()) {
      // Refused by old kernels only; then code is read in when it first runs.
      if (mapping.rights[2] == 'x' && is_of_program(line))
        (void)madvise(reinterpret_cast<void*>(mapping.begin), mapping.bytes(), MADV_POPULATE_READ);
      continue;
    }
    auto* const memory = reinterpret_cast<void*>(mapping.begin);
    if (madvise(memory, mapping.bytes(), MADV_POPULATE_WRITE) != 0) {
      if (errno != EINVAL)
        return fail(
            fmt::format("{} bytes of memory cannot be made resident: {}; plan fewer or "
                        "smaller sensors for this computer",
                        mapping.bytes(), std::strerror(errno)));
      touch(mapping);
    }
    held.held_bytes += mapping.bytes();
    if (mlock(memory, mapping.bytes()) == 0) held.locked_bytes += mapping.bytes();
  }
  return held;
}

[[gnu::noinline]] void hold_this_stack() {
  constexpr std::size_t kBytes = std::size_t{192} << 10U, kPage = 4096;
  char stack[kBytes];
  volatile char* const first = stack;  // so that the writes are not left out
  for (std::size_t at = 0; at < kBytes; at += kPage) first[at] = 0;
}

std::uint64_t thread_page_faults() {
  rusage usage{};
  WS_CHECK(getrusage(RUSAGE_THREAD, &usage) == 0, "getrusage");
  return static_cast<std::uint64_t>(usage.ru_minflt);
}

}  // namespace wagonsight
