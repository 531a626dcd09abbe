#pragma once

#include <string>

#include "status/health.h"

namespace wagonsight {

// What a person sends to whoever helps them: a zip of texts that tell the unit's state. No image,
// no position of a person and no secret is in it; the settings come with their secrets removed.
std::string diagnostics_zip(const StatusInput& input, const Health& health);

}  // namespace wagonsight
