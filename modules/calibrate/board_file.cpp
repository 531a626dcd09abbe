#include "calibrate/board_file.h"

#include <fmt/format.h>

#include "base/toml.h"

namespace wagonsight {

Result<Board> parse_board_file(std::string_view text, std::string_view file) {
  const toml::parse_result parsed = toml::parse(text, file);
  if (!parsed)
    return fail(fmt::format("{}:{}: {}", file, parsed.error().source().begin.line,
                            parsed.error().description()));
  const toml::table& root = parsed.table();
  for (const auto& [key, node] : root)
    if (key.str() != "rows" && key.str() != "columns" && key.str() != "square_m")
      return fail(fmt::format("{}:{}: {} is not a key of a board", file, node.source().begin.line,
                              key.str()));
  Board board;
  for (const auto& [key, side] : {std::pair{"rows", &board.rows}, {"columns", &board.columns}}) {
    const auto value = root[key].value<std::int64_t>();
    if (!value || *value < 2 || *value > 200)
      return fail(fmt::format("{}: {} must be a whole number of inner corners between 2 and 200",
                              file, key));
    *side = static_cast<int>(*value);
  }
  const auto square = root["square_m"].value<double>();
  if (!square || !(*square > 1e-4 && *square < 10))
    return fail(fmt::format("{}: square_m must be a length between 0.0001 and 10 metres", file));
  board.square_m = *square;
  return board;
}

}  // namespace wagonsight
