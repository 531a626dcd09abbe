#include "updater_link.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstring>
#include <string>
#include <thread>

namespace wagonsight {
namespace {

using ::testing::HasSubstr;

// Both ends of a socket; the other one is what a test plays.
class Link : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends_.data()), 0);
  }
  void TearDown() override {
    for (const int end : ends_)
      if (end >= 0) close(end);
  }
  void hang_up() {
    close(ends_[1]);
    ends_[1] = -1;
  }
  std::array<int, 2> ends_{-1, -1};
};

TEST_F(Link, CarriesTheCallAndItsBlock) {
  UpdaterLink link(ends_[0]);
  std::string heard;
  std::thread updater([&] {
    std::string message(1 << 17, '\0');
    const ssize_t size = recv(ends_[1], message.data(), message.size(), 0);
    heard = message.substr(0, static_cast<std::size_t>(size));
    std::string answer(sizeof(UpdaterAnswer), '\0');
    const UpdaterAnswer head{422};
    std::memcpy(answer.data(), &head, sizeof head);
    answer += "{\"error\":\"no\"}";
    (void)send(ends_[1], answer.data(), answer.size(), 0);
  });
  const std::string block(kUpdaterBlockBytesMax, 'x');
  const auto told = link.ask({UpdaterWish::kBlock, 7, 9}, block);
  updater.join();
  ASSERT_TRUE(told);
  EXPECT_EQ(told->status, 422);
  EXPECT_EQ(told->json, "{\"error\":\"no\"}");
  EXPECT_FALSE(link.is_lost());
  UpdaterCall call;
  ASSERT_EQ(heard.size(), sizeof call + block.size());
  std::memcpy(&call, heard.data(), sizeof call);
  EXPECT_EQ(call.wish, UpdaterWish::kBlock);
  EXPECT_EQ(call.offset, 7U);
  EXPECT_EQ(heard.substr(sizeof call), block);
}

TEST_F(Link, ThatBrokeIsToldAndNotWaitedForAgain) {
  UpdaterLink link(ends_[0]);
  hang_up();
  const auto told = link.ask({}, "");
  ASSERT_TRUE(told);
  EXPECT_EQ(told->status, 503);
  EXPECT_THAT(told->json, HasSubstr("does not answer"));
  EXPECT_TRUE(link.is_lost());
}

TEST_F(Link, ThatIsSilentIsLostAfterAWhile) {
  UpdaterLink link(ends_[0]);
  EXPECT_EQ(link.ask({}, "")->status, 503);
  EXPECT_TRUE(link.is_lost());
}

TEST(NoUpdater, IsNoLoss) {
  UpdaterLink link(999);
  EXPECT_FALSE(link.ask({}, ""));
  EXPECT_FALSE(link.is_lost());
  EXPECT_EQ(connect_updater(""), -1);
  EXPECT_EQ(connect_updater("/nowhere/socket"), -1);
}

}  // namespace
}  // namespace wagonsight
