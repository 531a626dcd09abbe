#include "web_side.h"

#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdio>
#include <ctime>
#include <memory>

#include "confine.h"
#include "http/server.h"
#include "shared_block.h"
#include "status/site.h"
#include "update/updater_call.h"
#include "updater_link.h"

namespace wagonsight {
namespace {

constexpr Duration kPeoplePeriod = std::chrono::milliseconds(100);
constexpr Duration kStatePeriod = std::chrono::seconds(1);
// A bundle comes in such blocks; everything else is smaller.
constexpr std::size_t kBodyBytesMax = kUpdaterBlockBytesMax;

double monotonic_seconds() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// A full buffer means that the daemon does not listen; it will notice by itself.
bool tell_daemon(const WebMessage& message) {
  return send(kWebLinkFd, &message, sizeof message, MSG_DONTWAIT | MSG_NOSIGNAL) ==
         static_cast<ssize_t>(sizeof message);
}

// Turns the server's requests into the site's and back, on the newest snapshot.
class WebSide : public HttpHandler {
 public:
  WebSide(const SharedBlock& block, const AccessRules& access)
      : block_(block),
        site_(access),
        snapshot_(std::make_unique<Snapshot>()),
        log_(std::make_unique<LogTail>()) {}

  ServerAnswer answer(const ServerRequest& request) override {
    HttpRequest asked;
    asked.method = request.method;
    asked.target = request.target;
    asked.host = request.host;
    asked.origin = request.origin;
    asked.authorization = request.authorization;
    asked.cookie = request.cookie;
    asked.accept_encoding = request.accept_encoding;
    asked.peer_is_loopback = request.peer_is_loopback;
    HttpAnswer answer = site_.answer(asked, input());
    if (answer.command &&
        !tell_daemon({static_cast<std::uint8_t>(answer.command->kind), 0, answer.command->minutes}))
      answer = error_answer(503, "The daemon does not listen just now; try again.");
    if (answer.updater) ask_updater(request, answer);
    return to_server(std::move(answer));
  }
  ServerAnswer refuse(int status) override { return to_server(refusal(status)); }

  bool lost_updater() const { return updater_.is_lost(); }

  void tell_people(HttpServer& server) {
    const std::uint64_t version = block_.snapshot.version();
    if (version == told_version_ || server.stream_count() == 0) return;
    told_version_ = version;
    server.broadcast(site_.stream_people(input()));
  }
  void tell_state(HttpServer& server) {
    if (server.stream_count() > 0) server.broadcast(site_.stream_state(input()));
  }

 private:
  void ask_updater(const ServerRequest& request, HttpAnswer& answer) {
    auto told = updater_.ask(*answer.updater, request.body);
    if (!told) return;  // there is none, as the answer says
    answer.status = told->status;
    answer.body = std::move(told->json);
  }

  static ServerAnswer to_server(HttpAnswer answer) {
    return {answer.status, std::move(answer.content_type), std::move(answer.body),
            std::move(answer.headers), answer.stream};
  }

  StatusInput input() {
    has_snapshot_ = block_.snapshot.load(*snapshot_) || has_snapshot_;
    const bool has_log = block_.log.load(*log_);
    StatusInput input;
    input.unit = &block_.unit;
    input.log = has_log ? log_.get() : nullptr;
    if (has_snapshot_) {
      input.snapshot = snapshot_.get();
      input.snapshot_age_s = monotonic_seconds() - snapshot_->monotonic_time;
    }
    return input;
  }

  const SharedBlock& block_;
  StatusSite site_;
  std::unique_ptr<Snapshot> snapshot_;
  std::unique_ptr<LogTail> log_;
  UpdaterLink updater_{kWebUpdaterFd};
  bool has_snapshot_ = false;
  std::uint64_t told_version_ = 0;
};

bool receive(WebGreeting& greeting) {
  return recv(kWebLinkFd, &greeting, sizeof greeting, MSG_WAITALL) ==
         static_cast<ssize_t>(sizeof greeting);
}

}  // namespace

int run_web_side() {
  WebGreeting greeting;
  if (!receive(greeting)) {
    std::fputs("wagonsightd: --web-side is what the daemon starts by itself; use --config\n",
               stderr);
    return 2;
  }
  const auto block = map_shared_block(kWebBlockFd);
  if (!block) {
    std::fprintf(stderr, "wagonsightd web side: %s\n", block.error().message.c_str());
    return 1;
  }
  const auto confined = confine_web_side(static_cast<int>(greeting.daemon_pid));
  if (!confined) {
    std::fprintf(stderr, "wagonsightd web side: %s\n", confined.error().message.c_str());
    return 1;
  }
  WebSide side(**block, greeting.access);
  HttpLimits limits;
  limits.body_bytes_max = kBodyBytesMax;
  HttpServer server(kWebListenFd, limits, side);
  server.every(kPeoplePeriod, [&] { side.tell_people(server); });
  server.every(kStatePeriod, [&] {
    side.tell_state(server);
    // Only the daemon can open another link: the next web side has it.
    if (side.lost_updater()) server.stop();
  });
  server.every(from_seconds(kHeartbeatPeriodS), [] { (void)tell_daemon({}); });
  server.when_readable(kWebLinkFd, [&] { server.stop(); });  // the daemon went
  server.run();
  return 0;
}

}  // namespace wagonsight
