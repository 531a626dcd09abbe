#pragma once

#include <string>
#include <string_view>

#include "base/result.h"
#include "snapshot/snapshot.h"

namespace wagonsight {

// The people file's line (see INTERFACES), without the newline. Numbers are written with fixed
// precision (time 6 decimals, metres and radians 4, quaternions 6, milliseconds 3), so that the
// same frame gives the same bytes everywhere. Truth has no sigma. What is not known is left out: a
// box or an ellipsoid of size zero, head, shoulders, views, and `since` and `last_seen` of truth.
// Appends to `out`.
void append_people_line(const PeopleFrame& frame, bool with_sigma, std::string& out);

// One person of that line.
void append_person(const Person& person, bool with_sigma, std::string& out);
// One event of that line.
void append_event(const Event& event, std::string& out);

// The inverse; keys it does not know are ignored, `time`, `people` and each person's `id` and
// `position` must be there. The Error names the key that is wrong. Texts longer than their place
// are cut. Allocates.
Result<PeopleFrame> parse_people_line(std::string_view line);

std::string_view to_text(Posture posture);       // "standing", "sitting", "lying", "unknown"
std::string_view to_text(EventKind kind);        // "fall", "motionless", ...
std::string_view to_text(Occupied state);        // "free", "occupied", "unobserved"
std::string_view to_text(RecordingState state);  // "off", "on", "no disk"
std::string_view to_text(ThermalBand band);      // "normal", "warm", "hot"
std::string_view to_text(SensorState state);     // "starting", "learning", "ok", "degraded", "lost"

}  // namespace wagonsight
