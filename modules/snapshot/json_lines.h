#pragma once

#include <string>
#include <string_view>

#include "base/result.h"
#include "snapshot/snapshot.h"

namespace wagonsight {

// The people file's line (see INTERFACES), without the newline. Numbers are written with fixed
// precision (time 6 decimals, metres 4), so that the same frame gives the same bytes everywhere.
// Truth has no sigma. Appends to `out`.
void append_people_line(const PeopleFrame& frame, bool with_sigma, std::string& out);

// The inverse; keys it does not know are ignored. The Error names the key that is wrong.
Result<PeopleFrame> parse_people_line(std::string_view line);

std::string_view to_text(Posture posture);    // "standing", "sitting", "lying", "unknown"
std::string_view to_text(EventKind kind);     // "fall", "motionless", ...
std::string_view to_text(Occupied state);     // "free", "occupied", "unobserved"
std::string_view to_text(SensorState state);  // "starting", "learning", "ok", "degraded", "lost"

}  // namespace wagonsight
