#include "http/server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

// The real server on a free port of the loopback, and peers that do not behave. Waits are for
// things to happen, never for how fast they happen.
namespace wagonsight {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

constexpr int kPatienceMs = 20'000;

class Peer {
 public:
  explicit Peer(std::uint16_t port) : fd_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = connect(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  ~Peer() { close(fd_); }
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  bool connected() const { return connected_; }
  bool say(std::string_view text) const {
    return send(fd_, text.data(), text.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(text.size());
  }
  // Reads until the other end closes, or until `mark` was seen.
  std::string hear(std::string_view mark = {}) const {
    std::string text;
    char part[4096];
    pollfd wanted{fd_, POLLIN, 0};
    while (poll(&wanted, 1, kPatienceMs) > 0) {
      const ssize_t size = recv(fd_, part, sizeof part, 0);
      if (size <= 0) return text;
      text.append(part, static_cast<std::size_t>(size));
      if (!mark.empty() && text.find(mark) != std::string::npos) return text;
    }
    ADD_FAILURE() << "nothing came for " << kPatienceMs << " ms";
    return text;
  }
  void shrink_receive_buffer() const {
    const int bytes = 4096;
    setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes);
  }

 private:
  int fd_;
  bool connected_ = false;
};

class Echo : public HttpHandler {
 public:
  ServerAnswer answer(const ServerRequest& request) override {
    ServerAnswer answer{
        200,
        "text/plain",
        request.method + " " + request.target + " " + request.host + " " + request.body,
        {},
        false};
    if (request.target == "/stream") {
      answer.stream = true;
      answer.body = "first\n";
    }
    return answer;
  }
  ServerAnswer refuse(int status) override {
    return {status, "application/json", "{\"error\":\"refused.\"}", {}, false};
  }
};

class Served {
 public:
  explicit Served(const HttpLimits& limits = {}) {
    const auto socket = listen_on("127.0.0.1", 0);
    if (!socket) throw std::runtime_error(socket.error().message);
    port_ = socket->port;
    server_ = std::make_unique<HttpServer>(socket->fd, limits, echo_);
    server_->every(std::chrono::milliseconds(5), [this] {
      streams_ = server_->stream_count();
      if (broadcasting_) server_->broadcast(std::string(64 * 1024, 'x') + "\n");
    });
    thread_ = std::thread([this] { server_->run(); });
  }
  ~Served() {
    server_->stop();
    thread_.join();
  }
  std::uint16_t port() const { return port_; }
  void wait_for_streams(std::size_t count) const {
    while (streams_ != count) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  std::atomic<bool> broadcasting_{false};
  std::atomic<std::size_t> streams_{0};

  std::string ask(std::string_view request) const {
    const Peer peer(port_);
    EXPECT_TRUE(peer.say(request));
    return peer.hear();
  }

 private:
  Echo echo_;
  std::uint16_t port_ = 0;
  std::unique_ptr<HttpServer> server_;
  std::thread thread_;
};

HttpLimits quick() {
  HttpLimits limits;
  limits.request_time_max = std::chrono::milliseconds(300);
  limits.write_time_max = std::chrono::milliseconds(300);
  return limits;
}

TEST(HttpServer, Answers) {
  const Served served;
  const std::string answer =
      served.ask("GET /a?b=c HTTP/1.1\r\nHost: unit\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200 OK\r\n"));
  EXPECT_THAT(answer, testing::EndsWith("\r\n\r\nGET /a?b=c unit "));
}

TEST(HttpServer, KeepsAConnectionForTheNextRequest) {
  const Served served;
  const Peer peer(served.port());
  ASSERT_TRUE(
      peer.say("POST /one HTTP/1.1\r\nHost: u\r\nContent-Length: 4\r\n\r\nbody"
               "GET /two HTTP/1.1\r\nHost: u\r\nConnection: close\r\n\r\n"));
  const std::string both = peer.hear();
  EXPECT_THAT(both, HasSubstr("POST /one u body"));
  EXPECT_THAT(both, HasSubstr("GET /two u "));
}

TEST(HttpServer, GivesHeadTheLengthWithoutTheBody) {
  const Served served;
  const std::string answer = served.ask("HEAD /a HTTP/1.1\r\nHost: u\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(answer, HasSubstr("Content-Length: 10\r\n"));
  EXPECT_THAT(answer, testing::EndsWith("\r\n\r\n"));
}

struct Refused {
  const char* name;
  std::string request;
  std::string status;
};
class HttpRefusal : public testing::TestWithParam<Refused> {};

TEST_P(HttpRefusal, IsTold) {
  const Served served;
  const std::string answer = served.ask(GetParam().request);
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 " + GetParam().status));
  EXPECT_THAT(answer, HasSubstr("Content-Type: application/json\r\n"));
  EXPECT_THAT(answer, testing::EndsWith("{\"error\":\"refused.\"}"));
}

const Refused kRefused[] = {
    {"NotHttp", "hello there\r\n\r\n", "400"},
    {"BinaryNoise", std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", 11) + "\r\n\r\n",
     "400"},
    {"BadVersion", "GET / HTTP/9.9\r\n\r\n", "400"},
    {"BadHeader", "GET / HTTP/1.1\r\nHost: u\r\nno colon\r\n\r\n", "400"},
    {"OversizedHeader", "GET / HTTP/1.1\r\nHost: u\r\nX: " + std::string(20'000, 'a') + "\r\n\r\n",
     "431"},
    {"EndlessRequestLine", "GET /" + std::string(60'000, 'a'), "431"},
    {"OversizedBody", "POST / HTTP/1.1\r\nHost: u\r\nContent-Length: 10000000\r\n\r\nabc", "413"},
    {"OversizedChunks",
     "POST / HTTP/1.1\r\nHost: u\r\nTransfer-Encoding: chunked\r\n\r\n"
     "5000\r\n" +
         std::string(0x5000, 'a') + "\r\n0\r\n\r\n",
     "413"},
    {"TwoLengths",
     "POST / HTTP/1.1\r\nHost: u\r\nContent-Length: 4\r\nContent-Length: 5\r\n\r\nabcd", "400"},
};
INSTANTIATE_TEST_SUITE_P(Each, HttpRefusal, testing::ValuesIn(kRefused),
                         [](const auto& each) { return each.param.name; });

TEST(HttpServer, ClosesOnAPeerThatDripsItsRequest) {
  const Served served(quick());
  const Peer peer(served.port());
  ASSERT_TRUE(peer.say("GET / HTTP/1.1\r\nHost: u\r\n"));
  // A header line now and then would keep a naive server waiting for ever.
  bool closed = false;
  for (int i = 0; i < 2000 && !closed; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    closed = !peer.say("X-Drip: 1\r\n");
  }
  EXPECT_TRUE(closed);
}

TEST(HttpServer, ClosesOnAPeerThatSaysNothing) {
  const Served served(quick());
  EXPECT_EQ(Peer(served.port()).hear(), "");
}

TEST(HttpServer, BoundsConnectionsOfOnePeer) {
  HttpLimits limits;
  limits.connections_per_peer_max = 4;
  const Served served(limits);
  std::vector<std::unique_ptr<Peer>> idle;
  // An answer of each shows that the server has taken it.
  for (int i = 0; i < 4; ++i) {
    idle.push_back(std::make_unique<Peer>(served.port()));
    ASSERT_TRUE(idle.back()->say("GET /" + std::to_string(i) + " HTTP/1.1\r\nHost: u\r\n\r\n"));
    idle.back()->hear(" u ");
  }
  EXPECT_THAT(Peer(served.port()).hear(), StartsWith("HTTP/1.1 503"));
  idle.pop_back();
  std::string answer;
  while (!answer.starts_with("HTTP/1.1 200"))  // the server notices the free place in its own time
    answer = served.ask("GET /again HTTP/1.1\r\nHost: u\r\nConnection: close\r\n\r\n");
}

TEST(HttpServer, BoundsAllConnections) {
  HttpLimits limits;
  limits.connections_max = 3;
  const Served served(limits);
  std::vector<std::unique_ptr<Peer>> idle;
  for (int i = 0; i < 3; ++i) {
    idle.push_back(std::make_unique<Peer>(served.port()));
    ASSERT_TRUE(idle.back()->say("GET / HTTP/1.1\r\nHost: u\r\n\r\n"));
    idle.back()->hear(" u ");
  }
  EXPECT_THAT(Peer(served.port()).hear(), StartsWith("HTTP/1.1 503"));
}

TEST(HttpServer, StreamsBlocksToEveryPeer) {
  Served served;
  const Peer one(served.port()), other(served.port());
  ASSERT_TRUE(one.say("GET /stream HTTP/1.1\r\nHost: u\r\n\r\n"));
  ASSERT_TRUE(other.say("GET /stream HTTP/1.1\r\nHost: u\r\n\r\n"));
  EXPECT_THAT(one.hear("first\n"), StartsWith("HTTP/1.1 200 OK\r\n"));
  other.hear("first\n");
  served.wait_for_streams(2);
  served.broadcasting_ = true;
  EXPECT_THAT(one.hear("x\n"), HasSubstr("xxx"));
  EXPECT_THAT(other.hear("x\n"), HasSubstr("xxx"));
}

TEST(HttpServer, BoundsTheNumberOfStreams) {
  HttpLimits limits;
  limits.streams_max = 1;
  const Served served(limits);
  const Peer one(served.port());
  ASSERT_TRUE(one.say("GET /stream HTTP/1.1\r\nHost: u\r\n\r\n"));
  one.hear("first\n");
  EXPECT_THAT(served.ask("GET /stream HTTP/1.1\r\nHost: u\r\nConnection: close\r\n\r\n"),
              StartsWith("HTTP/1.1 503"));
}

TEST(HttpServer, LetsGoOfAStreamThatDoesNotRead) {
  Served served(quick());
  const Peer lazy(served.port()), eager(served.port());
  lazy.shrink_receive_buffer();
  for (const Peer* peer : {&lazy, &eager})
    ASSERT_TRUE(peer->say("GET /stream HTTP/1.1\r\nHost: u\r\n\r\n"));
  served.wait_for_streams(2);
  served.broadcasting_ = true;
  // The one that reads goes on being served; the other one is dropped.
  std::atomic<bool> done{false};
  std::thread reader([&] {
    while (!done) eager.hear("x\n");
  });
  served.wait_for_streams(1);
  done = true;
  reader.join();
}

TEST(HttpServer, ForgetsAStreamWhosePeerLeft) {
  Served served;
  {
    const Peer peer(served.port());
    ASSERT_TRUE(peer.say("GET /stream HTTP/1.1\r\nHost: u\r\n\r\n"));
    served.wait_for_streams(1);
  }
  served.wait_for_streams(0);
}

TEST(Listen, TakesNumericAddressesOnly) {
  const auto named = listen_on("localhost", 0);
  ASSERT_FALSE(named.has_value());
  EXPECT_EQ(named.error().message,
            "web address 'localhost': is not a numeric address; write one like 127.0.0.1 or [::1]");
  EXPECT_TRUE(is_loopback_address("127.0.0.53"));
  EXPECT_FALSE(is_loopback_address("127.evil.example"));
  EXPECT_FALSE(is_loopback_address("0.0.0.0"));
}

TEST(Listen, SaysWhenThePortIsTaken) {
  const auto first = listen_on("127.0.0.1", 0);
  ASSERT_TRUE(first.has_value());
  const auto second = listen_on("127.0.0.1", first->port);
  ASSERT_FALSE(second.has_value());
  EXPECT_THAT(second.error().message, HasSubstr("Address already in use; choose another port"));
  close(first->fd);
}

}  // namespace
}  // namespace wagonsight
