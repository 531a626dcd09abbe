#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "http/server.h"

namespace wagonsight {

// For a page that a program serves to the person who started it, on loopback only: why a request
// is refused, or nothing. The Host must be the loopback's name with this port (else a foreign name
// was made to point here) and an Origin, which browsers send with everything that changes
// something, this page's own (else another site's page is asking).
std::optional<ServerAnswer> refuse_unless_own_page(const ServerRequest& request,
                                                   std::uint16_t port);

// An answer that says one sentence, as {"error": "..."}. The sentence must be plain text; quotes
// and control characters are replaced.
ServerAnswer sentence_answer(int status, std::string sentence);

}  // namespace wagonsight
