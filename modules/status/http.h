#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "update/updater_call.h"

// What the site needs of a request, and what it says in return: no sockets in here.
namespace wagonsight {

struct HttpRequest {
  std::string_view method;  // "GET", "HEAD", "POST"
  std::string_view target;  // path and query, as sent
  std::string_view host, origin, authorization, cookie, accept_encoding;
  bool peer_is_loopback = false;

  std::string_view path() const { return target.substr(0, target.find('?')); }
  // The text after '?', empty when there is none.
  std::string_view query() const {
    const auto mark = target.find('?');
    return mark == std::string_view::npos ? std::string_view() : target.substr(mark + 1);
  }
};

// A write. Flat: it crosses from the web side to the daemon.
struct UnitCommand {
  enum class Kind : std::uint8_t { kStartRecording = 1, kStopRecording = 2 };
  Kind kind = Kind::kStopRecording;
  std::uint16_t minutes = 0;  // of a recording
};

struct HttpAnswer {
  int status = 200;
  std::string content_type = "application/json";
  std::string body;
  std::vector<std::pair<std::string, std::string>> headers;
  // What the daemon is asked to do, by one who may.
  std::optional<UnitCommand> command;
  // What the updater is asked, by one who may; its answer takes this one's place, which says that
  // there is no updater.
  std::optional<UpdaterCall> updater;
  bool stream = false;  // the body is the beginning of a stream of server-sent events
};

// An error as every one of them is told: {"error":"<one sentence>"}.
HttpAnswer error_answer(int status, std::string_view sentence);

}  // namespace wagonsight
