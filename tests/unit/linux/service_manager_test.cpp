#include "linux/service_manager.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string>

namespace wagonsight {
namespace {

// A service manager's end of the socket.
class Listener {
 public:
  explicit Listener(const std::string& address) {
    fd_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    sockaddr_un at{};
    at.sun_family = AF_UNIX;
    std::memcpy(at.sun_path, address.data(), address.size());
    if (address[0] == '@') at.sun_path[0] = '\0';
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address.size());
    EXPECT_EQ(bind(fd_, reinterpret_cast<const sockaddr*>(&at), size), 0) << address;
  }
  ~Listener() { close(fd_); }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  std::string hear() const {
    std::array<char, 512> text{};
    const ssize_t size = recv(fd_, text.data(), text.size(), 0);
    return {text.data(), size > 0 ? static_cast<std::size_t>(size) : 0};
  }

 private:
  int fd_ = -1;
};

class Notify : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override { unlink(address_.c_str()); }
  void TearDown() override {
    unlink(address_.c_str());
    for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) unsetenv(name);
  }
  std::string address_ = GetParam() + std::to_string(getpid());
};

TEST_P(Notify, SpeaksTheProtocol) {
  const Listener listener(address_);
  setenv("NOTIFY_SOCKET", address_.c_str(), 1);
  ServiceManager manager;
  EXPECT_TRUE(manager.is_listening());
  EXPECT_FALSE(manager.watchdog());
  manager.status("two sensors");
  manager.ready();
  manager.alive();
  manager.stopping();
  EXPECT_EQ(listener.hear(), "STATUS=two sensors\n");
  EXPECT_EQ(listener.hear(), "READY=1\n");
  EXPECT_EQ(listener.hear(), "WATCHDOG=1\n");
  EXPECT_EQ(listener.hear(), "STOPPING=1\n");
  EXPECT_EQ(std::getenv("NOTIFY_SOCKET"), nullptr) << "a child would speak in its parent's name";
}

INSTANTIATE_TEST_SUITE_P(Addresses, Notify,
                         testing::Values("/tmp/wagonsight_notify_", "@wagonsight_notify_"));

TEST(ServiceManager, KnowsWhetherTheWatchdogIsMeant) {
  setenv("NOTIFY_SOCKET", "@wagonsight_nobody", 1);
  setenv("WATCHDOG_USEC", "10000000", 1);
  setenv("WATCHDOG_PID", std::to_string(getpid()).c_str(), 1);
  EXPECT_EQ(ServiceManager().watchdog(), std::chrono::seconds(10));
  setenv("NOTIFY_SOCKET", "@wagonsight_nobody", 1);
  setenv("WATCHDOG_USEC", "10000000", 1);
  setenv("WATCHDOG_PID", "1", 1);
  EXPECT_FALSE(ServiceManager().watchdog());
}

TEST(ServiceManager, DoesWithoutAndNeverBlocksOnADeafOne) {
  ServiceManager none;
  EXPECT_FALSE(none.is_listening());
  none.ready();
  setenv("NOTIFY_SOCKET", "no address", 1);
  EXPECT_FALSE(ServiceManager().is_listening());
  const std::string address = "@wagonsight_deaf_" + std::to_string(getpid());
  const Listener deaf(address);
  setenv("NOTIFY_SOCKET", address.c_str(), 1);
  ServiceManager manager;
  for (int i = 0; i < 5000; ++i) manager.alive();  // more than a socket holds
}

}  // namespace
}  // namespace wagonsight
