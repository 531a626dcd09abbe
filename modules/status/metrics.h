#pragma once

#include <string>

#include "status/health.h"

namespace wagonsight {

// Prometheus' text format 0.0.4: base units, prefix wagonsight_, HELP and TYPE before each family.
// Works without a snapshot too: then only what is known of the process is told.
std::string metrics_text(const StatusInput& input, const Health& health);

}  // namespace wagonsight
