#include "status/site.h"

#include <fmt/format.h>
#include <sodium.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <optional>
#include <span>

#include "base/check.h"
#include "snapshot/json_lines.h"
#include "status/answers.h"
#include "status/diagnostics.h"
#include "status/metrics.h"
#include "status/page.h"
#include "status/zip.h"

namespace wagonsight {
namespace {

constexpr std::string_view kNotYet = "Nothing was published yet; the daemon is starting.";

// A hash-source of Content-Security-Policy level 2: only this very text may run.
std::string csp_hash(std::string_view text) {
  std::array<unsigned char, crypto_hash_sha256_BYTES> hash{};
  crypto_hash_sha256(hash.data(), reinterpret_cast<const unsigned char*>(text.data()), text.size());
  std::array<char,
             sodium_base64_ENCODED_LEN(crypto_hash_sha256_BYTES, sodium_base64_VARIANT_ORIGINAL)>
      base64{};
  sodium_bin2base64(base64.data(), base64.size(), hash.data(), hash.size(),
                    sodium_base64_VARIANT_ORIGINAL);
  return fmt::format("'sha256-{}'", base64.data());
}

std::string with(std::string_view html, std::string_view mark, std::string_view text) {
  const std::size_t at = html.find(mark);
  WS_CHECK(at != std::string_view::npos, "the page lacks a mark");
  return fmt::format("{}{}{}", html.substr(0, at), text, html.substr(at + mark.size()));
}

HttpAnswer json_answer(const answers::Json& value) {
  HttpAnswer answer;
  answer.body = answers::text_of(value) + "\n";
  answer.headers.emplace_back("Cache-Control", "no-store");
  return answer;
}

HttpAnswer text_answer(std::string_view content_type, std::string body) {
  HttpAnswer answer;
  answer.content_type = content_type;
  answer.body = std::move(body);
  answer.headers.emplace_back("Cache-Control", "no-store");
  return answer;
}

std::string stream_block(std::string_view event, std::string_view data) {
  return fmt::format("event: {}\ndata: {}\n\n", event, data);
}

// The number behind `key` in a query; false when there is none.
bool read_number(std::string_view query, std::string_view key, std::uint64_t& number) {
  while (!query.empty()) {
    const std::string_view item = query.substr(0, query.find('&'));
    query.remove_prefix(std::min(item.size() + 1, query.size()));
    if (!item.starts_with(key)) continue;
    const char* end = item.data() + item.size();
    const auto read = std::from_chars(item.data() + key.size(), end, number);
    return read.ec == std::errc{} && read.ptr == end;
  }
  return false;
}

std::string verbose_checks(const Health& health) {
  std::string text;
  for (const Check& check : health.checks)
    text += fmt::format("[{}]{} {}\n", check.passed ? '+' : '-', check.name, check.detail);
  return text + (health.ready ? "ready\n" : "not ready\n");
}

}  // namespace

struct StatusSite::State {
  explicit State(const AccessRules& rules) : gate(rules) {
    page = with(with(page::kHtml, "<!--style-->", page::kStyle), "<!--script-->", page::kScript);
    page_gzip = make_gzip(page);
    page_policy = fmt::format(
        "default-src 'none'; script-src {}; style-src {}; connect-src 'self'; img-src data:; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
        csp_hash(page::kScript), csp_hash(page::kStyle));
  }

  struct Route {
    std::string_view path;
    Scope scope;
    HttpAnswer (State::*answer)(const HttpRequest&, const StatusInput&) const;
    bool needs_snapshot = false;
    std::string_view method = "GET";
  };
  static std::span<const Route> routes();

  HttpAnswer page_answer(const HttpRequest& request, const StatusInput&) const {
    HttpAnswer answer = text_answer("text/html; charset=utf-8", page);
    answer.headers.emplace_back("Content-Security-Policy", page_policy);
    answer.headers.emplace_back("Vary", "Accept-Encoding");
    if (request.accept_encoding.find("gzip") != std::string_view::npos) {
      answer.body = page_gzip;
      answer.headers.emplace_back("Content-Encoding", "gzip");
    }
    return answer;
  }
  HttpAnswer live(const HttpRequest&, const StatusInput& input) const {
    if (input.snapshot != nullptr && input.snapshot_age_s <= HealthLimits{}.snapshot_age_s_max)
      return text_answer("text/plain; charset=utf-8", "ok\n");
    return error_answer(503, assess(input).sentence);
  }
  HttpAnswer ready(const HttpRequest& request, const StatusInput& input) const {
    const Health health = assess(input);
    if (request.query().starts_with("verbose")) {
      HttpAnswer answer = text_answer("text/plain; charset=utf-8", verbose_checks(health));
      answer.status = health.ready ? 200 : 503;
      return answer;
    }
    return health.ready ? text_answer("text/plain; charset=utf-8", "ok\n")
                        : error_answer(503, health.sentence);
  }
  HttpAnswer metrics(const HttpRequest&, const StatusInput& input) const {
    return text_answer("text/plain; version=0.0.4; charset=utf-8",
                       metrics_text(input, assess(input)));
  }
  HttpAnswer health(const HttpRequest&, const StatusInput& input) const {
    return json_answer(answers::health(input, assess(input)));
  }
  HttpAnswer sensors(const HttpRequest&, const StatusInput& input) const {
    return json_answer(answers::sensors(*input.snapshot));
  }
  HttpAnswer pipeline(const HttpRequest&, const StatusInput& input) const {
    return json_answer(answers::pipeline(*input.snapshot));
  }
  HttpAnswer calibration(const HttpRequest&, const StatusInput& input) const {
    return json_answer(answers::calibration(*input.snapshot));
  }
  HttpAnswer occupancy(const HttpRequest&, const StatusInput& input) const {
    return json_answer(answers::occupancy(*input.snapshot));
  }
  HttpAnswer plan(const HttpRequest&, const StatusInput& input) const {
    return json_answer(answers::plan(*input.unit));
  }
  HttpAnswer people(const HttpRequest&, const StatusInput& input) const {
    HttpAnswer answer = text_answer("application/json", "");
    append_people_line(input.snapshot->frame, true, answer.body);
    answer.body += '\n';
    return answer;
  }
  HttpAnswer events(const HttpRequest&, const StatusInput& input) const {
    HttpAnswer answer = text_answer("text/event-stream", "retry: 1000\n\n");
    answer.stream = true;
    answer.headers.emplace_back("X-Accel-Buffering", "no");
    answer.body += state_block(input);
    if (input.snapshot != nullptr) answer.body += people_block(*input.snapshot);
    return answer;
  }
  HttpAnswer diagnostics(const HttpRequest&, const StatusInput& input) const {
    HttpAnswer answer = text_answer("application/zip", diagnostics_zip(input, assess(input)));
    answer.headers.emplace_back("Content-Disposition",
                                "attachment; filename=\"wagonsight-diagnostics.zip\"");
    return answer;
  }
  HttpAnswer log(const HttpRequest&, const StatusInput& input) const {
    return json_answer(answers::log(input.log != nullptr ? *input.log : LogTail{}));
  }
  HttpAnswer version(const HttpRequest&, const StatusInput& input) const {
    return json_answer(answers::version(*input.unit));
  }
  HttpAnswer openapi(const HttpRequest&, const StatusInput&) const {
    return text_answer("application/json", std::string(page::kOpenApi));
  }
  HttpAnswer licenses(const HttpRequest&, const StatusInput&) const {
    return text_answer("text/plain; charset=utf-8", std::string(page::kLicenses));
  }
  // ---- what the updater is asked; the body of a request goes with it
  static HttpAnswer asked(const UpdaterCall& call) {
    HttpAnswer answer = error_answer(
        501, "This unit has no updater: it does not run from a flashed image, or not with one.");
    answer.updater = call;
    return answer;
  }
  HttpAnswer update(const HttpRequest&, const StatusInput&) const {
    return asked({UpdaterWish::kTell, 0, 0});
  }
  HttpAnswer take_block(const HttpRequest& request, const StatusInput&) const {
    UpdaterCall call{UpdaterWish::kBlock, 0, 0};
    const std::string_view query = request.query();
    if (!read_number(query, "at=", call.offset))
      return error_answer(400, "Say where the block belongs: ?at=BYTES&of=BYTES_IN_ALL.");
    read_number(query, "of=", call.total);
    return asked(call);
  }
  HttpAnswer discard_update(const HttpRequest&, const StatusInput&) const {
    return asked({UpdaterWish::kDiscard, 0, 0});
  }
  HttpAnswer restart(const HttpRequest&, const StatusInput&) const {
    return asked({UpdaterWish::kRestart, 0, 0});
  }
  HttpAnswer factory_reset(const HttpRequest&, const StatusInput&) const {
    return asked({UpdaterWish::kFactoryReset, 0, 0});
  }
  HttpAnswer gtfs(const HttpRequest&, const StatusInput&) const {
    return error_answer(501,
                        "This build does not write GTFS-realtime yet; read "
                        "/api/v1/occupancy instead.");
  }
  HttpAnswer session(const HttpRequest& request, const StatusInput&) const {
    const Scope scope = gate.scope_of(request);
    return json_answer({{"scope", scope == Scope::kAdmin  ? "admin"
                                  : scope == Scope::kRead ? "read"
                                                          : "none"},
                        {"tokens_configured", gate.has_tokens()}});
  }
  HttpAnswer login(const HttpRequest& request, const StatusInput& input) const {
    const std::string cookie = gate.session_cookie(request);
    if (cookie.empty()) {
      const auto refused = gate.refuse_below(Scope::kAdmin, request);
      return refused ? *refused : error_answer(400, "Send the token as 'Authorization: Bearer'.");
    }
    HttpAnswer answer = session(request, input);
    answer.headers.emplace_back("Set-Cookie", cookie);
    return answer;
  }

  HttpAnswer recording(const HttpRequest&, const StatusInput& input) const {
    return json_answer(answers::recording(*input.snapshot));
  }
  HttpAnswer vehicle(const HttpRequest&, const StatusInput& input) const {
    return json_answer(answers::vehicle(*input.snapshot, *input.unit));
  }
  HttpAnswer start_recording(const HttpRequest& request, const StatusInput& input) const {
    if (input.unit->recording_minutes_max == 0)
      return error_answer(409, "This unit has no folder for recordings; set recording.folder.");
    std::uint64_t minutes = 0;
    if (!read_number(request.query(), "minutes=", minutes) || minutes < 1 ||
        minutes > input.unit->recording_minutes_max)
      return error_answer(400, fmt::format("Say for how long: ?minutes=N, from 1 to {}.",
                                           input.unit->recording_minutes_max));
    return accepted({UnitCommand::Kind::kStartRecording, static_cast<std::uint16_t>(minutes)});
  }
  HttpAnswer stop_recording(const HttpRequest&, const StatusInput&) const {
    return accepted({UnitCommand::Kind::kStopRecording, 0});
  }
  static HttpAnswer accepted(const UnitCommand& command) {
    HttpAnswer answer = json_answer({{"accepted", true}});
    answer.status = 202;
    answer.command = command;
    return answer;
  }

  static std::string people_block(const Snapshot& snapshot) {
    std::string line;
    append_people_line(snapshot.frame, true, line);
    return stream_block("people", line);
  }
  static std::string state_block(const StatusInput& input) {
    answers::Json state;
    state["health"] = answers::health(input, assess(input));
    if (input.snapshot != nullptr) {
      state["occupancy"] = answers::occupancy(*input.snapshot);
      state["sensors"] = answers::sensors(*input.snapshot)["sensors"];
      state["calibration"] = answers::calibration(*input.snapshot);
      state["pipeline"] = answers::pipeline(*input.snapshot);
    }
    return stream_block("state", answers::text_of(state));
  }

  HttpAnswer dispatch(const HttpRequest& request, const StatusInput& input) const;

  Gate gate;
  std::string page, page_gzip, page_policy;
};

std::span<const StatusSite::State::Route> StatusSite::State::routes() {
  using S = State;
  static constexpr std::array kRoutes = {
      Route{"/", Scope::kNone, &S::page_answer},
      Route{"/livez", Scope::kNone, &S::live},
      Route{"/readyz", Scope::kNone, &S::ready},
      Route{"/healthz", Scope::kNone, &S::ready},
      Route{"/metrics", Scope::kNone, &S::metrics},
      Route{"/licenses", Scope::kNone, &S::licenses},
      Route{"/api/v1/health", Scope::kNone, &S::health},
      Route{"/api/v1/sensors", Scope::kNone, &S::sensors, true},
      Route{"/api/v1/pipeline", Scope::kNone, &S::pipeline, true},
      Route{"/api/v1/calibration", Scope::kNone, &S::calibration, true},
      Route{"/api/v1/occupancy", Scope::kNone, &S::occupancy, true},
      Route{"/api/v1/plan", Scope::kNone, &S::plan},
      Route{"/api/v1/version", Scope::kNone, &S::version},
      Route{"/api/v1/openapi.json", Scope::kNone, &S::openapi},
      Route{"/api/v1/update", Scope::kNone, &S::update},
      Route{"/api/v1/update", Scope::kAdmin, &S::take_block, false, "POST"},
      Route{"/api/v1/update", Scope::kAdmin, &S::discard_update, false, "DELETE"},
      Route{"/api/v1/restart", Scope::kAdmin, &S::restart, false, "POST"},
      Route{"/api/v1/factory-reset", Scope::kAdmin, &S::factory_reset, false, "POST"},
      Route{"/api/v1/gtfs-rt", Scope::kNone, &S::gtfs},
      Route{"/api/v1/people", Scope::kRead, &S::people, true},
      Route{"/api/v1/events", Scope::kRead, &S::events},
      Route{"/api/v1/log", Scope::kRead, &S::log},
      Route{"/api/v1/diagnostics.zip", Scope::kRead, &S::diagnostics},
      Route{"/api/v1/vehicle", Scope::kNone, &S::vehicle, true},
      Route{"/api/v1/recording", Scope::kNone, &S::recording, true},
      Route{"/api/v1/recording", Scope::kAdmin, &S::start_recording, true, "POST"},
      Route{"/api/v1/recording", Scope::kAdmin, &S::stop_recording, true, "DELETE"},
      Route{"/api/v1/session", Scope::kNone, &S::session},
      Route{"/api/v1/session", Scope::kNone, &S::login, false, "POST"},
  };
  return kRoutes;
}

HttpAnswer StatusSite::State::dispatch(const HttpRequest& request, const StatusInput& input) const {
  if (auto refused = gate.refuse_foreign(request)) return *refused;
  const std::string_view method = request.method == "HEAD" ? "GET" : request.method;
  std::string allowed;
  for (const Route& route : routes()) {
    if (route.path != request.path()) continue;
    if (route.method != method) {
      allowed += fmt::format("{}{}", allowed.empty() ? "" : ", ", route.method);
      continue;
    }
    if (auto refused = gate.refuse_below(route.scope, request)) return *refused;
    if (route.needs_snapshot && input.snapshot == nullptr) return error_answer(503, kNotYet);
    return (this->*route.answer)(request, input);
  }
  if (allowed.empty())
    return error_answer(404, "There is nothing at this address; /api/v1/openapi.json lists all.");
  HttpAnswer answer =
      error_answer(405, fmt::format("This address only takes the method {}.", allowed));
  answer.headers.emplace_back("Allow", allowed);
  return answer;
}

StatusSite::StatusSite(const AccessRules& rules) : state_(std::make_unique<State>(rules)) {}
StatusSite::~StatusSite() = default;

HttpAnswer StatusSite::answer(const HttpRequest& request, const StatusInput& input) const {
  HttpAnswer answer = state_->dispatch(request, input);
  answer.headers.emplace_back("X-Content-Type-Options", "nosniff");
  answer.headers.emplace_back("Referrer-Policy", "no-referrer");
  answer.headers.emplace_back("Cross-Origin-Resource-Policy", "same-origin");
  return answer;
}

std::string StatusSite::stream_people(const StatusInput& input) const {
  return input.snapshot != nullptr ? State::people_block(*input.snapshot) : std::string();
}
std::string StatusSite::stream_state(const StatusInput& input) const {
  return State::state_block(input);
}

HttpAnswer refusal(int status) {
  switch (status) {
    case 400:
      return error_answer(400, "This is not a well-formed HTTP request.");
    case 413:
      return error_answer(413, "The request's body is too large for this unit.");
    case 431:
      return error_answer(431, "The request's header is too large for this unit.");
    case 503:
      return error_answer(503, "Too many connections are open; close some and try again.");
    default:
      return error_answer(status, "The request was refused.");
  }
}

}  // namespace wagonsight
