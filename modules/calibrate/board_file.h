#pragma once

#include <string_view>

#include "base/result.h"
#include "calibrate/observations.h"

namespace wagonsight {

// BOARD.toml: rows, columns (inner corners), square_m. The Error names file, line, key and rule.
Result<Board> parse_board_file(std::string_view toml, std::string_view file);

}  // namespace wagonsight
