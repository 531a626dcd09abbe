#pragma once

#include <string>
#include <vector>

#include "base/result.h"

namespace wagonsight {

// Runs a program to its end, found by PATH when its name has no slash. The Error is what it said on
// stderr, or that it could not be run. `argv` begins with the program. Allocates; any thread.
Result<void> run_program(const std::vector<std::string>& argv);

}  // namespace wagonsight
