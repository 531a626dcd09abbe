#include "linux/service_manager.h"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdlib>
#include <cstring>

namespace wagonsight {
namespace {

std::string take_from_environment(const char* name) {
  const char* value = std::getenv(name);
  std::string text = value != nullptr ? value : "";
  unsetenv(name);
  return text;
}

std::optional<std::int64_t> number(const std::string& text) {
  std::int64_t value = 0;
  const auto end = text.data() + text.size();
  const auto read = std::from_chars(text.data(), end, value);
  if (read.ec != std::errc{} || read.ptr != end || value <= 0) return std::nullopt;
  return value;
}

}  // namespace

ServiceManager::ServiceManager() : address_(take_from_environment("NOTIFY_SOCKET")) {
  const auto watchdog_us = number(take_from_environment("WATCHDOG_USEC"));
  const auto watchdog_pid = number(take_from_environment("WATCHDOG_PID"));
  // A path, or a name in the abstract space; anything else is none of this protocol.
  if (address_.size() < 2 || (address_[0] != '/' && address_[0] != '@') ||
      address_.size() >= sizeof(sockaddr_un::sun_path))
    return;
  fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (watchdog_us && (!watchdog_pid || *watchdog_pid == ::getpid()))
    watchdog_ = std::chrono::microseconds(*watchdog_us);
}

ServiceManager::~ServiceManager() {
  if (fd_ >= 0) ::close(fd_);
}

void ServiceManager::send(std::string_view text) const {
  if (fd_ < 0) return;
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  std::copy(address_.begin(), address_.end(), to.sun_path);
  if (to.sun_path[0] == '@') to.sun_path[0] = '\0';
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
  (void)::sendto(fd_, text.data(), text.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
                 reinterpret_cast<const sockaddr*>(&to), size);
}

void ServiceManager::ready() {
  send("READY=1\n");
}

void ServiceManager::alive() {
  send("WATCHDOG=1\n");
}

void ServiceManager::stopping() {
  send("STOPPING=1\n");
}

void ServiceManager::status(std::string_view sentence) {
  send(fmt::format("STATUS={}\n", sentence));
}

}  // namespace wagonsight
