#pragma once

#include <chrono>
#include <cstdint>
#include <string_view>

namespace wagonsight {

// One line on a terminal that says how far a long job is: done, rate, time left. Silent when
// standard error is no terminal.
class Progress {
 public:
  // `total` 0: unknown. `unit` is what is counted, in the plural.
  Progress(std::string_view unit, std::uint64_t total);
  ~Progress();  // clears the line
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void update(std::uint64_t done);

 private:
  using Clock = std::chrono::steady_clock;
  std::string_view unit_;
  std::uint64_t total_;
  bool on_terminal_;
  Clock::time_point begin_, shown_;
};

}  // namespace wagonsight
