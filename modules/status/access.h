#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>

#include "base/fixed_string.h"
#include "base/fixed_vector.h"
#include "status/http.h"

// Who may ask for what.
namespace wagonsight {

using Token = FixedString<128>;

// Flat, so that the daemon can hand it to its web side in memory that nobody else maps.
struct AccessRules {
  Token read_token, admin_token;  // empty: none is configured
  bool bound_to_loopback = true;
  bool trusted_network = false;        // tokens may cross it without TLS
  FixedVector<Name, 8> host_names;     // the unit is called by, besides numeric addresses
  std::array<std::uint8_t, 32> key{};  // random, made at the daemon's start; signs the cookies
};
static_assert(std::is_trivially_copyable_v<AccessRules>);

enum class Scope : std::uint8_t { kNone, kRead, kAdmin };

class Gate {
 public:
  explicit Gate(const AccessRules& rules);

  // Refuses requests that a foreign page caused: a Host that is neither numeric, localhost nor one
  // of the unit's names (DNS rebinding), or an Origin that is not this site's own. Nothing: passes.
  std::optional<HttpAnswer> refuse_foreign(const HttpRequest& request) const;

  // What this request may do. Without any token everything may be read on loopback, and nothing
  // that needs a token elsewhere.
  Scope scope_of(const HttpRequest& request) const;

  // Nothing when the request has the scope; otherwise the answer that says why not.
  std::optional<HttpAnswer> refuse_below(Scope needed, const HttpRequest& request) const;

  // The cookie that stands for the request's bearer token in a browser: HttpOnly, SameSite=Strict.
  // It is a keyed hash of the token, so it is void when the token or the daemon changes. Empty
  // when the request carries no valid token.
  std::string session_cookie(const HttpRequest& request) const;

  bool has_tokens() const;

 private:
  Scope scope_of_token(std::string_view token) const;
  Scope scope_of_cookie(std::string_view cookies) const;
  bool token_may_travel(const HttpRequest& request) const;
  std::string signature_of(const Token& token) const;

  AccessRules rules_;
};

}  // namespace wagonsight
