#include "http/local_page.h"

#include <fmt/format.h>

#include <algorithm>

namespace wagonsight {

ServerAnswer sentence_answer(int status, std::string sentence) {
  std::replace_if(
      sentence.begin(), sentence.end(),
      [](unsigned char c) { return c == '"' || c == '\\' || c < 0x20; }, '\'');
  ServerAnswer answer;
  answer.status = status;
  answer.content_type = "application/json";
  answer.body = "{\"error\":\"" + sentence + "\"}\n";
  answer.headers.emplace_back("Cache-Control", "no-store");
  return answer;
}

std::optional<ServerAnswer> refuse_unless_own_page(const ServerRequest& request,
                                                   std::uint16_t port) {
  if (!request.peer_is_loopback)
    return sentence_answer(403, "This page is for the machine it runs on.");
  bool known = false;
  for (const char* name : {"127.0.0.1", "localhost", "[::1]"})
    known = known || request.host == fmt::format("{}:{}", name, port) ||
            (port == 80 && request.host == name);
  if (!known)
    return sentence_answer(421, "This page is not called by that host name; use its address.");
  if (!request.origin.empty() && request.origin != "http://" + request.host)
    return sentence_answer(403, "Another site's page asked for this; open the tool's own page.");
  return std::nullopt;
}

}  // namespace wagonsight
