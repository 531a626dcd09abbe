#pragma once

#include <sys/types.h>

#include <nlohmann/json.hpp>
#include <string>

#include "base/result.h"

namespace wagonsight::device::usbip {

// The unit's daemon, run as it is on a unit: the program, the user without rights, its page.
class DaemonRun {
 public:
  // Starts it with these settings as user and group 100, as the image does.
  static Result<DaemonRun> start(const std::string& program, const std::string& settings,
                                 const std::string& state_folder);
  DaemonRun(DaemonRun&& other) noexcept : pid_(std::exchange(other.pid_, 0)) {}
  DaemonRun& operator=(DaemonRun&&) = delete;
  DaemonRun(const DaemonRun&) = delete;
  DaemonRun& operator=(const DaemonRun&) = delete;
  // Kills it where it was not stopped.
  ~DaemonRun();

  struct Answer {
    int status = 0;  // 0: nobody answers
    nlohmann::json body;
  };
  Answer ask(const std::string& method, const std::string& path, const std::string& token) const;
  // Asks it to end, as init does, and says how it did: its exit code, or 128 and a signal.
  int stop();

  static constexpr int kPort = 8080;

 private:
  explicit DaemonRun(pid_t pid) : pid_(pid) {}
  pid_t pid_ = 0;
};

}  // namespace wagonsight::device::usbip
