#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "status/health.h"

// The bodies of the API's answers. Private to the module: its headers stay free of nlohmann-json.
namespace wagonsight::answers {

using Json = nlohmann::ordered_json;

// Text that is always valid JSON: bytes that are not UTF-8 are replaced.
std::string text_of(const Json& value);

Json health(const StatusInput& input, const Health& health);
Json sensors(const Snapshot& snapshot);
Json recording(const Snapshot& snapshot);
Json vehicle(const Snapshot& snapshot, const UnitInfo& unit);
Json pipeline(const Snapshot& snapshot);
Json calibration(const Snapshot& snapshot);
Json occupancy(const Snapshot& snapshot);  // counts, never a person
Json plan(const UnitInfo& unit);
Json log(const LogTail& log);
Json version(const UnitInfo& unit);

}  // namespace wagonsight::answers
