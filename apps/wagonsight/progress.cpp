#include "progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

namespace wagonsight {
namespace {

constexpr auto kRedraw = std::chrono::milliseconds(200);
constexpr std::string_view kClearLine = "\r\x1b[K";

}  // namespace

Progress::Progress(std::string_view unit, std::uint64_t total)
    : unit_(unit),
      total_(total),
      on_terminal_(::isatty(STDERR_FILENO) == 1),
      begin_(Clock::now()),
      shown_(begin_) {}

Progress::~Progress() {
  if (on_terminal_) fmt::print(stderr, "{}", kClearLine);
}

void Progress::update(std::uint64_t done) {
  if (!on_terminal_) return;
  const auto now = Clock::now();
  if (now - shown_ < kRedraw) return;
  shown_ = now;
  const double seconds = std::chrono::duration<double>(now - begin_).count();
  const double rate = static_cast<double>(done) / seconds;
  if (total_ == 0 || done > total_) {
    fmt::print(stderr, "{}{} {}, {:.1f} a second", kClearLine, done, unit_, rate);
  } else {
    const double left = static_cast<double>(total_ - done) / rate;
    fmt::print(stderr, "{}{} of {} {}, {:.1f} a second, {:.0f} s left", kClearLine, done, total_,
               unit_, rate, left);
  }
  std::fflush(stderr);
}

}  // namespace wagonsight
