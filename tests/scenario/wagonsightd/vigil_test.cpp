#include "vigil.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdlib>

namespace wagonsight {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

TEST(StageWatch, NamesWhatStandsStillForLongest) {
  StageWatch watch;
  const std::size_t tracking = watch.add("tracking", 5, 100);
  const std::size_t driver = watch.add("driver", 30, 100);
  watch.see(tracking, 1, 104);
  EXPECT_EQ(watch.stuck(109), nullptr);
  ASSERT_NE(watch.stuck(110), nullptr);
  EXPECT_EQ(*watch.stuck(110), "tracking");
  watch.see(tracking, 1, 111);  // the same count is no progress
  EXPECT_NE(watch.stuck(111), nullptr);
  watch.see(tracking, 2, 111);
  EXPECT_EQ(watch.stuck(112), nullptr);
  watch.see(tracking, 3, 130);
  EXPECT_EQ(*watch.stuck(131), "driver");
  watch.dismiss(driver);
  EXPECT_EQ(watch.stuck(131), nullptr);
}

// What a service manager hears.
class Heard : public testing::Test {
 protected:
  void SetUp() override {
    fd_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const std::string name = "@wagonsight_vigil_" + std::to_string(getpid());
    sockaddr_un at{};
    at.sun_family = AF_UNIX;
    std::copy(name.begin() + 1, name.end(), at.sun_path + 1);
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    ASSERT_EQ(bind(fd_, reinterpret_cast<const sockaddr*>(&at), size), 0);
    setenv("NOTIFY_SOCKET", name.c_str(), 1);
  }
  void TearDown() override { close(fd_); }
  std::string hear() const {
    std::string all;
    std::array<char, 512> text{};
    for (ssize_t got = 0; (got = recv(fd_, text.data(), text.size(), 0)) > 0;)
      all.append(text.data(), static_cast<std::size_t>(got));
    return all;
  }
  int fd_ = -1;
};

TEST_F(Heard, NoHeartbeatWhileAStageStandsStill) {
  Vigil vigil("");
  std::uint64_t turns = 1;
  std::vector<std::string> said;
  const auto say = [&](std::string_view text) { said.emplace_back(text); };
  vigil.watch(
      "The tracking", 5, [&] { return std::optional(turns); }, 0);
  vigil.tick(1, 0, say);
  EXPECT_EQ(hear(), "WATCHDOG=1\n");
  vigil.tick(1.1, 0, say);
  EXPECT_EQ(hear(), "") << "more often than is asked for";
  vigil.tick(7, 0, say);
  EXPECT_THAT(hear(), testing::AllOf(HasSubstr("STATUS=The tracking stands still"),
                                     testing::Not(HasSubstr("WATCHDOG"))));
  vigil.tick(9, 0, say);
  EXPECT_EQ(hear(), "");
  ++turns;
  vigil.tick(10, 0, say);
  EXPECT_THAT(hear(), HasSubstr("WATCHDOG=1\n"));
  EXPECT_THAT(said, ElementsAre(HasSubstr("stands still"), HasSubstr("goes on again")));
}

TEST_F(Heard, AStageThatEndedAsItMayIsNotMissed) {
  Vigil vigil("");
  vigil.watch(
      "The recording", 5, [] { return std::optional<std::uint64_t>(); }, 0);
  vigil.tick(100, 0, [](std::string_view) {});
  EXPECT_EQ(hear(), "WATCHDOG=1\n");
}

}  // namespace
}  // namespace wagonsight
