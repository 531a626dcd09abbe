#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/result.h"
#include "base/time.h"

// A small HTTP/1.1 server for one thread, made to be left alone with the world: everything that a
// peer could make it hold is bounded in size, number and time.
namespace wagonsight {

struct ServerRequest {
  std::string method, target, body;
  std::string host, origin, authorization, cookie, accept_encoding;
  bool peer_is_loopback = false;
};

struct ServerAnswer {
  int status = 200;
  std::string content_type;
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers;
  // The body is the beginning of a stream that broadcast() goes on with until the peer leaves.
  bool stream = false;
};

class HttpHandler {
 public:
  virtual ~HttpHandler() = default;
  virtual ServerAnswer answer(const ServerRequest& request) = 0;
  // What to say when there is no request to answer: 400 malformed, 413 body too large, 431 header
  // too large, 503 too many connections or streams.
  virtual ServerAnswer refuse(int status) = 0;
};

struct HttpLimits {
  std::size_t header_bytes_max = 8192;
  std::size_t body_bytes_max = 16'384;
  std::size_t connections_max = 64;
  std::size_t connections_per_peer_max = 32;  // a browser opens six to a site
  std::size_t streams_max = 16;
  std::size_t stream_queue_max = 16;  // blocks; the oldest is dropped and counted
  // From the first waiting for a request to its last byte, so a peer that sends a byte now and then
  // gains nothing; an idle connection is closed by the same clock.
  Duration request_time_max = std::chrono::seconds(10);
  Duration write_time_max = std::chrono::seconds(10);  // of one answer, or one block of a stream
};

class HttpServer {
 public:
  // Takes over a socket that listens (see listen_on).
  HttpServer(int listening_socket, const HttpLimits& limits, HttpHandler& handler);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  // Work to be done on the server's thread, from run() on.
  void every(Duration period, std::function<void()> work);
  // `work` is called once, when `fd` can be read or was closed by its other end. The caller keeps
  // fd.
  void when_readable(int fd, std::function<void()> work);

  // Sends a block to every stream. On the server's thread only.
  void broadcast(std::string block);
  std::size_t stream_count() const;

  // Serves until stop(), which any thread may call.
  void run();
  void stop();

  struct Counters {
    std::uint64_t accepted = 0, refused = 0, requests = 0, stream_blocks_dropped = 0;
  };
  Counters counters() const;  // on the server's thread, or after run()

 private:
  struct State;
  std::unique_ptr<State> state_;
};

struct ListeningSocket {
  int fd = -1;  // close-on-exec, non-blocking
  std::uint16_t port = 0;
};

// Listens on a numeric IPv4 or IPv6 address; names are refused, since nothing here asks a name
// server. Port 0 takes a free one.
Result<ListeningSocket> listen_on(std::string_view address, std::uint16_t port);

// Whether a numeric address is one of the loopback's.
bool is_loopback_address(std::string_view address);

}  // namespace wagonsight
