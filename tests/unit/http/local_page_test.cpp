// Who may ask a page that is meant for the person at this machine.
#include "http/local_page.h"

#include <gtest/gtest.h>

namespace wagonsight {
namespace {

ServerRequest request(std::string host, std::string origin = {}, bool loopback = true) {
  ServerRequest asked;
  asked.host = std::move(host);
  asked.origin = std::move(origin);
  asked.peer_is_loopback = loopback;
  return asked;
}

int status(const ServerRequest& asked) {
  const auto refused = refuse_unless_own_page(asked, 8090);
  return refused ? refused->status : 200;
}

TEST(LocalPage, TakesItsOwnNamesAndOrigin) {
  EXPECT_EQ(status(request("127.0.0.1:8090")), 200);
  EXPECT_EQ(status(request("localhost:8090", "http://localhost:8090")), 200);
  EXPECT_EQ(status(request("[::1]:8090", "http://[::1]:8090")), 200);
}

TEST(LocalPage, RefusesForeignNamesPortsOriginsAndPeers) {
  EXPECT_EQ(status(request("evil.example:8090")), 421);
  EXPECT_EQ(status(request("127.0.0.1:8091")), 421);
  EXPECT_EQ(status(request("127.0.0.1.evil.example:8090")), 421);
  EXPECT_EQ(status(request("")), 421);
  EXPECT_EQ(status(request("127.0.0.1:8090", "http://evil.example")), 403);
  EXPECT_EQ(status(request("127.0.0.1:8090", "http://localhost:8090")), 403);
  EXPECT_EQ(status(request("127.0.0.1:8090", "https://127.0.0.1:8090")), 403);
  EXPECT_EQ(status(request("127.0.0.1:8090", "null")), 403);
  EXPECT_EQ(status(request("127.0.0.1:8090", "", false)), 403);
}

TEST(LocalPage, ASentenceIsSoundJsonWhateverIsInIt) {
  EXPECT_EQ(sentence_answer(400, "a \"b\" \\ \n").body, "{\"error\":\"a 'b' ' '\"}\n");
}

}  // namespace
}  // namespace wagonsight
