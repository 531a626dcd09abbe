#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "evaluate/evaluate.h"
#include "snapshot/json_lines.h"

// Any text as a people file: read, or refused by line; a line that is read and written again reads
// the same from then on.
namespace {

void require(bool holds) {
  if (!holds) std::abort();
}

std::string written(const wagonsight::PeopleFrame& frame) {
  std::string line;
  wagonsight::append_people_line(frame, true, line);
  return line;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto instants = wagonsight::parse_people_file(text);
  if (!instants) require(instants.error().message.starts_with("line "));

  const auto frame = wagonsight::parse_people_line(text);
  if (!frame) {
    require(!frame.error().message.empty());
    return 0;
  }
  // What is written is always a line that can be read.
  const auto again = wagonsight::parse_people_line(written(*frame));
  require(again.has_value());
  require(again->people.size() == frame->people.size());
  require(again->events.size() == frame->events.size());
  return 0;
}
