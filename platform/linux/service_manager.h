#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "base/time.h"

namespace wagonsight {

// Tells whoever started this process how it is, by systemd's notify protocol: datagrams of
// KEY=value lines to the socket that NOTIFY_SOCKET names. Without one, everything here does
// nothing. Never blocks and never fails: a service manager that does not listen is not the unit's
// trouble.
class ServiceManager {
 public:
  // Reads NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID and takes them out of the environment, so
  // that no child speaks in this process's name. Before any thread.
  ServiceManager();
  ~ServiceManager();
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;

  bool is_listening() const { return fd_ >= 0; }
  // How long the manager waits for alive() before it ends this process; nullopt: it does not wait.
  std::optional<Duration> watchdog() const { return watchdog_; }

  void ready();
  void alive();
  void stopping();
  void status(std::string_view sentence);

 private:
  void send(std::string_view text) const;

  std::string address_;
  std::optional<Duration> watchdog_;
  int fd_ = -1;
};

}  // namespace wagonsight
