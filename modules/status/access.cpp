#include "status/access.h"

#include <sodium.h>

#include <algorithm>
#include <cctype>

#include "base/check.h"
#include "snapshot/json_text.h"

namespace wagonsight {
namespace {

constexpr std::string_view kBearer = "Bearer ";
constexpr std::string_view kCookie = "wagonsight=";

// Takes the same time for every guess of a length, also for guesses of a wrong length: both sides
// are hashed first.
bool equal_in_constant_time(std::string_view a, std::string_view b) {
  std::array<unsigned char, crypto_generichash_BYTES> hash_a{}, hash_b{};
  const auto hash = [](std::string_view text, auto& out) {
    crypto_generichash(out.data(), out.size(), reinterpret_cast<const unsigned char*>(text.data()),
                       text.size(), nullptr, 0);
  };
  hash(a, hash_a);
  hash(b, hash_b);
  return sodium_memcmp(hash_a.data(), hash_b.data(), hash_a.size()) == 0;
}

bool equal_ignoring_case(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](unsigned char x, unsigned char y) {
    return std::tolower(x) == std::tolower(y);
  });
}

// The host without its port: "[::1]:8080" is "[::1]", "unit:80" is "unit".
std::string_view without_port(std::string_view host) {
  if (!host.empty() && host.front() == '[') return host.substr(0, host.find(']') + 1);
  return host.substr(0, host.find(':'));
}

// A numeric address cannot be made to point elsewhere by a foreign name server.
bool is_numeric(std::string_view host) {
  if (host.size() > 2 && host.front() == '[' && host.back() == ']')
    return host.find_first_not_of("0123456789abcdefABCDEF:.[]") == std::string_view::npos;
  return !host.empty() && host.find_first_not_of("0123456789.") == std::string_view::npos &&
         std::count(host.begin(), host.end(), '.') == 3;
}

// The value of our cookie among the request's, empty when it is not there.
std::string_view find_cookie(std::string_view cookies) {
  while (!cookies.empty()) {
    const std::size_t end = std::min(cookies.find(';'), cookies.size());
    std::string_view one = cookies.substr(0, end);
    while (!one.empty() && one.front() == ' ') one.remove_prefix(1);
    if (one.starts_with(kCookie)) return one.substr(kCookie.size());
    cookies.remove_prefix(std::min(end + 1, cookies.size()));
  }
  return {};
}

std::string_view bearer_of(const HttpRequest& request) {
  return request.authorization.starts_with(kBearer) ? request.authorization.substr(kBearer.size())
                                                    : std::string_view();
}

}  // namespace

HttpAnswer error_answer(int status, std::string_view sentence) {
  HttpAnswer answer;
  answer.status = status;
  answer.body = "{\"error\":";
  append_quoted(answer.body, sentence);
  answer.body += "}\n";
  answer.headers.emplace_back("Cache-Control", "no-store");
  return answer;
}

Gate::Gate(const AccessRules& rules) : rules_(rules) {
  WS_CHECK(sodium_init() >= 0, "libsodium could not be initialised");
}

bool Gate::has_tokens() const {
  return !rules_.read_token.empty() || !rules_.admin_token.empty();
}

std::optional<HttpAnswer> Gate::refuse_foreign(const HttpRequest& request) const {
  const std::string_view host = without_port(request.host);
  const bool known = is_numeric(host) || equal_ignoring_case(host, "localhost") ||
                     std::any_of(rules_.host_names.begin(), rules_.host_names.end(),
                                 [&](const Name& name) { return equal_ignoring_case(host, name); });
  if (!known)
    return error_answer(421,
                        "This unit is not called by that host name; use its address, or add "
                        "the name to the settings' host names.");
  if (request.origin.empty()) return std::nullopt;
  std::string_view origin = request.origin;
  const std::size_t scheme = origin.find("://");
  origin.remove_prefix(scheme == std::string_view::npos ? 0 : scheme + 3);
  if (scheme == std::string_view::npos || !equal_ignoring_case(origin, request.host))
    return error_answer(403, "Another site's page asked for this; open the unit's own page.");
  return std::nullopt;
}

bool Gate::token_may_travel(const HttpRequest& request) const {
  return request.peer_is_loopback || rules_.trusted_network;
}

Scope Gate::scope_of_token(std::string_view token) const {
  // Both are always compared, so that the time tells nothing about which one it was.
  const bool admin = equal_in_constant_time(token, rules_.admin_token);
  const bool read = equal_in_constant_time(token, rules_.read_token);
  if (token.empty()) return Scope::kNone;
  return admin ? Scope::kAdmin : read ? Scope::kRead : Scope::kNone;
}

std::string Gate::signature_of(const Token& token) const {
  static_assert(crypto_generichash_KEYBYTES <= sizeof rules_.key);
  std::array<unsigned char, crypto_generichash_BYTES> hash{};
  const std::string_view text = token.view();
  crypto_generichash(hash.data(), hash.size(), reinterpret_cast<const unsigned char*>(text.data()),
                     text.size(), rules_.key.data(), rules_.key.size());
  std::string hex(2 * hash.size() + 1, '\0');
  sodium_bin2hex(hex.data(), hex.size(), hash.data(), hash.size());
  hex.pop_back();
  return hex;
}

Scope Gate::scope_of_cookie(std::string_view cookies) const {
  const std::string_view value = find_cookie(cookies);
  const bool admin = equal_in_constant_time(value, signature_of(rules_.admin_token));
  const bool read = equal_in_constant_time(value, signature_of(rules_.read_token));
  if (admin && !rules_.admin_token.empty()) return Scope::kAdmin;
  return read && !rules_.read_token.empty() ? Scope::kRead : Scope::kNone;
}

Scope Gate::scope_of(const HttpRequest& request) const {
  if (!has_tokens())
    return rules_.bound_to_loopback && request.peer_is_loopback ? Scope::kRead : Scope::kNone;
  if (!token_may_travel(request)) return Scope::kNone;
  return std::max(scope_of_token(bearer_of(request)), scope_of_cookie(request.cookie));
}

std::optional<HttpAnswer> Gate::refuse_below(Scope needed, const HttpRequest& request) const {
  const Scope scope = scope_of(request);
  if (scope >= needed) return std::nullopt;
  if (!has_tokens())
    return error_answer(403, rules_.bound_to_loopback
                                 ? "Changes need an admin token; set one in the settings."
                                 : "Off loopback this needs a token; set one in the settings.");
  if (!token_may_travel(request))
    return error_answer(403,
                        "Tokens are only accepted behind TLS or on a network that the "
                        "settings call trusted.");
  if (scope == Scope::kRead) return error_answer(403, "This needs the admin token.");
  HttpAnswer answer = error_answer(401, "Send the token as 'Authorization: Bearer TOKEN'.");
  answer.headers.emplace_back("WWW-Authenticate", "Bearer realm=\"wagonsight\"");
  return answer;
}

std::string Gate::session_cookie(const HttpRequest& request) const {
  if (!token_may_travel(request)) return {};
  const Scope scope = scope_of_token(bearer_of(request));
  if (scope == Scope::kNone) return {};
  const Token& token = scope == Scope::kAdmin ? rules_.admin_token : rules_.read_token;
  return std::string(kCookie) + signature_of(token) + "; Path=/; HttpOnly; SameSite=Strict";
}

}  // namespace wagonsight
