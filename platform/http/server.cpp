#include "http/server.h"

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <deque>
#include <map>
#include <optional>
#include <set>

namespace wagonsight {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;
using Block = std::shared_ptr<const std::string>;
using Response = http::response<http::string_body>;

constexpr auto kAcceptPause = std::chrono::milliseconds(100);  // when out of descriptors
constexpr auto kFarewellTime = std::chrono::seconds(1);
constexpr std::size_t kFarewellBytes = 65'536;

class Connection;

// What connections and the server have in common; all of one thread.
struct Shared {
  HttpLimits limits;
  HttpHandler* handler = nullptr;
  HttpServer::Counters counters;
  std::size_t connection_count = 0;
  std::map<asio::ip::address, std::size_t> per_peer;
  std::set<Connection*> streams;
};

Response to_response(const ServerAnswer& answer, unsigned version) {
  Response response{static_cast<http::status>(answer.status), version};
  response.set(http::field::server, "wagonsight");
  if (!answer.content_type.empty()) response.set(http::field::content_type, answer.content_type);
  for (const auto& [name, value] : answer.headers) response.insert(name, value);
  response.body() = answer.body;
  return response;
}

// By hand: Beast's own operator needs the C++ library's streams and locales, 400 kB of a static
// program.
std::string to_text(const Response& response) {
  std::string text = "HTTP/1.1 " + std::to_string(response.result_int());
  const auto add = [&text](std::string_view before, boost::beast::string_view words) {
    text.append(before).append(words.data(), words.size());
  };
  add(" ", response.reason());
  for (const auto& field : response) {
    add("\r\n", field.name_string());
    add(": ", field.value());
  }
  add("\r\n\r\n", response.body());
  return text;
}

// Lives as long as an operation of its own is pending.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(tcp::socket socket, asio::ip::address peer, Shared& shared)
      : stream_(std::move(socket)),
        peer_(std::move(peer)),
        shared_(shared),
        buffer_(shared.limits.header_bytes_max + shared.limits.body_bytes_max) {
    ++shared_.connection_count;
    ++shared_.per_peer[peer_];
  }
  ~Connection() {
    shared_.streams.erase(this);
    --shared_.connection_count;
    const auto entry = shared_.per_peer.find(peer_);
    if (--entry->second == 0) shared_.per_peer.erase(entry);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void read_request() {
    parser_.emplace();
    parser_->header_limit(static_cast<std::uint32_t>(shared_.limits.header_bytes_max));
    parser_->body_limit(shared_.limits.body_bytes_max);
    stream_.expires_after(shared_.limits.request_time_max);
    http::async_read(
        stream_, buffer_, *parser_,
        [self = shared_from_this()](error_code error, std::size_t) { self->on_request(error); });
  }

  void offer(const Block& block) {
    if (queue_.size() >= shared_.limits.stream_queue_max) {
      // The one at the front may be on its way; the next is the oldest that can still be dropped.
      queue_.erase(queue_.begin() + (queue_.size() > 1 ? 1 : 0));
      ++shared_.counters.stream_blocks_dropped;
    }
    queue_.push_back(block);
    if (!writing_) write_block();
  }

 private:
  void on_request(error_code error) {
    if (error) return on_bad_request(error);
    ++shared_.counters.requests;
    const http::request<http::string_body> request = parser_->release();
    ServerRequest asked;
    asked.method = std::string(request.method_string());
    asked.target = std::string(request.target());
    asked.body = request.body();
    asked.host = std::string(request[http::field::host]);
    asked.origin = std::string(request[http::field::origin]);
    asked.authorization = std::string(request[http::field::authorization]);
    asked.cookie = std::string(request[http::field::cookie]);
    asked.accept_encoding = std::string(request[http::field::accept_encoding]);
    asked.peer_is_loopback = peer_.is_loopback();

    const bool head = request.method() == http::verb::head;
    ServerAnswer answer = shared_.handler->answer(asked);
    if (answer.stream && !head && shared_.streams.size() >= shared_.limits.streams_max) {
      ++shared_.counters.refused;
      answer = shared_.handler->refuse(503);
    }
    if (answer.stream && !head) return start_stream(answer, request.version());
    write(answer, request.version(), head, request.keep_alive());
  }

  void on_bad_request(error_code error) {
    const int status =
        error == http::error::body_limit                                               ? 413
        : error == http::error::header_limit                                           ? 431
        : error == http::error::buffer_overflow                                        ? 431
        : error == http::error::end_of_stream || error == http::error::partial_message ? 0
        : error.category() == make_error_code(http::error::bad_method).category()      ? 400
                                                                                       : 0;
    if (status == 0) return;  // the peer went, or took too long: nobody is left to be told
    ++shared_.counters.refused;
    write(shared_.handler->refuse(status), 11, false, false);
  }

  void write(const ServerAnswer& answer, unsigned version, bool head, bool keep_alive) {
    response_ = to_response(answer, version);
    response_.keep_alive(keep_alive);
    response_.prepare_payload();
    if (head) response_.body().clear();  // Content-Length keeps telling what GET would give
    stream_.expires_after(shared_.limits.write_time_max);
    http::async_write(stream_, response_,
                      [self = shared_from_this(), keep_alive](error_code error, std::size_t) {
                        if (error) return;
                        if (keep_alive) return self->read_request();
                        self->say_farewell();
                      });
  }

  // Closing at once while the peer still sends would reset the connection and lose the answer: read
  // for a moment what is left.
  void say_farewell() {
    error_code ignored;
    stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    stream_.expires_after(kFarewellTime);
    buffer_.consume(buffer_.size());
    drain();
  }
  void drain() {
    stream_.async_read_some(asio::buffer(waste_),
                            [self = shared_from_this()](error_code error, std::size_t size) {
                              self->drained_ += size;
                              if (!error && self->drained_ < kFarewellBytes) self->drain();
                            });
  }

  void start_stream(const ServerAnswer& answer, unsigned version) {
    response_ = to_response(answer, version);
    response_.keep_alive(false);  // the stream ends with the connection
    stream_.expires_after(shared_.limits.write_time_max);
    writing_ = true;
    shared_.streams.insert(this);
    http::async_write(stream_, response_,
                      [self = shared_from_this()](error_code error, std::size_t) {
                        if (error) return self->leave();
                        self->response_ = {};
                        self->stream_.expires_never();
                        self->watch_peer();
                        self->on_written();
                      });
  }
  // A stream's peer has nothing to say; reading only tells when it goes.
  void watch_peer() {
    stream_.async_read_some(asio::buffer(waste_),
                            [self = shared_from_this()](error_code error, std::size_t size) {
                              self->drained_ += size;
                              if (error || self->drained_ > kFarewellBytes) return self->leave();
                              self->watch_peer();
                            });
  }
  void write_block() {
    writing_ = true;
    stream_.expires_after(shared_.limits.write_time_max);
    asio::async_write(stream_, asio::buffer(*queue_.front()),
                      [self = shared_from_this()](error_code error, std::size_t) {
                        if (error) return self->leave();
                        self->queue_.pop_front();
                        self->on_written();
                      });
  }
  void on_written() {
    writing_ = false;
    if (!queue_.empty()) write_block();
  }
  void leave() {
    shared_.streams.erase(this);
    stream_.close();
  }

  beast::tcp_stream stream_;
  asio::ip::address peer_;
  Shared& shared_;
  beast::flat_buffer buffer_;
  std::optional<http::request_parser<http::string_body>> parser_;
  Response response_;
  std::deque<Block> queue_;
  bool writing_ = false;
  std::array<char, 1024> waste_{};
  std::size_t drained_ = 0;
};

}  // namespace

struct HttpServer::State {
  struct Ticker {
    asio::steady_timer timer;
    Duration period;
    std::function<void()> work;
  };

  State(int listening_socket, const HttpLimits& limits, HttpHandler& handler)
      : acceptor(context), accept_timer(context) {
    sockaddr_storage bound{};
    socklen_t size = sizeof bound;
    const bool known =
        getsockname(listening_socket, reinterpret_cast<sockaddr*>(&bound), &size) == 0;
    acceptor.assign(known && bound.ss_family == AF_INET6 ? tcp::v6() : tcp::v4(), listening_socket);
    shared.limits = limits;
    shared.handler = &handler;
  }

  void accept() {
    acceptor.async_accept([this](error_code error, tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      if (error) {
        accept_timer.expires_after(kAcceptPause);
        accept_timer.async_wait([this](error_code) { accept(); });
        return;
      }
      take(std::move(socket));
      accept();
    });
  }

  void take(tcp::socket socket) {
    error_code error;
    const tcp::endpoint peer = socket.remote_endpoint(error);
    if (error) return;
    ++shared.counters.accepted;
    const auto known = shared.per_peer.find(peer.address());
    const std::size_t of_peer = known == shared.per_peer.end() ? 0 : known->second;
    if (shared.connection_count >= shared.limits.connections_max ||
        of_peer >= shared.limits.connections_per_peer_max)
      return turn_away(std::move(socket));
    std::make_shared<Connection>(std::move(socket), peer.address(), shared)->read_request();
  }

  // One attempt to say why, without holding anything for it.
  void turn_away(tcp::socket socket) {
    ++shared.counters.refused;
    Response response = to_response(shared.handler->refuse(503), 11);
    response.keep_alive(false);
    response.prepare_payload();
    const std::string bytes = to_text(response);
    error_code ignored;
    socket.non_blocking(true, ignored);
    socket.write_some(asio::buffer(bytes), ignored);
    socket.shutdown(tcp::socket::shutdown_send, ignored);
  }

  void tick(Ticker& ticker) {
    ticker.timer.async_wait([this, &ticker](error_code error) {
      if (error) return;
      ticker.work();
      // From now on, not from when it was due: after a pause nothing is made up for.
      ticker.timer.expires_after(ticker.period);
      tick(ticker);
    });
  }

  Shared shared;  // outlives the context, whose pending handlers own connections
  asio::io_context context{1};
  tcp::acceptor acceptor;
  asio::steady_timer accept_timer;
  std::deque<Ticker> tickers;
  std::deque<asio::posix::stream_descriptor> watched;
};

HttpServer::HttpServer(int listening_socket, const HttpLimits& limits, HttpHandler& handler)
    : state_(std::make_unique<State>(listening_socket, limits, handler)) {}

HttpServer::~HttpServer() {
  for (auto& descriptor : state_->watched) descriptor.release();  // the caller's
}

void HttpServer::every(Duration period, std::function<void()> work) {
  auto& ticker = state_->tickers.emplace_back(
      State::Ticker{asio::steady_timer(state_->context, period), period, std::move(work)});
  state_->tick(ticker);
}

void HttpServer::when_readable(int fd, std::function<void()> work) {
  auto& descriptor = state_->watched.emplace_back(state_->context, fd);
  descriptor.async_wait(asio::posix::stream_descriptor::wait_read,
                        [work = std::move(work)](error_code error) {
                          if (error != asio::error::operation_aborted) work();
                        });
}

void HttpServer::broadcast(std::string block) {
  if (state_->shared.streams.empty()) return;
  const auto shared_block = std::make_shared<const std::string>(std::move(block));
  for (Connection* stream : state_->shared.streams) stream->offer(shared_block);
}

std::size_t HttpServer::stream_count() const {
  return state_->shared.streams.size();
}

void HttpServer::run() {
  state_->accept();
  state_->context.run();
}

void HttpServer::stop() {
  state_->context.stop();
}

HttpServer::Counters HttpServer::counters() const {
  return state_->shared.counters;
}

}  // namespace wagonsight
