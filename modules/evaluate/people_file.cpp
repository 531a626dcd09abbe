#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "evaluate/evaluate.h"
#include "snapshot/json_lines.h"

namespace wagonsight {
namespace {

// The id that is there twice, 0 when none is.
bool find_twice(const Instant& instant, std::uint32_t& id) {
  std::vector<std::uint32_t> ids;
  for (const PersonSeen& person : instant.people) ids.push_back(person.id);
  std::sort(ids.begin(), ids.end());
  const auto twice = std::adjacent_find(ids.begin(), ids.end());
  if (twice == ids.end()) return false;
  id = *twice;
  return true;
}

}  // namespace

Instant to_instant(const PeopleFrame& frame) {
  Instant instant;
  instant.time = frame.time;
  for (const Person& person : frame.people) {
    instant.people.push_back({person.id, person.position, person.height, person.posture});
  }
  return instant;
}

Result<std::vector<Instant>> parse_people_file(std::string_view text) {
  std::vector<Instant> instants;
  std::size_t number = 0;
  while (!text.empty()) {
    ++number;
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (line.find_first_not_of(" \t\r") == std::string_view::npos) continue;
    // A PeopleFrame is large; it lives on the heap and only as long as its line.
    auto frame = std::make_unique<Result<PeopleFrame>>(parse_people_line(line));
    if (!frame->has_value()) {
      return fail(fmt::format("line {}: {}", number, frame->error().message));
    }
    Instant instant = to_instant(**frame);
    if (!instants.empty() && instant.time < instants.back().time) {
      return fail(fmt::format("line {}: time goes back from {:.6f} to {:.6f} s; sort the lines",
                              number, instants.back().time, instant.time));
    }
    std::uint32_t id = 0;
    if (find_twice(instant, id)) {
      return fail(
          fmt::format("line {}: person {} is there twice; give each its own id", number, id));
    }
    instants.push_back(std::move(instant));
  }
  return instants;
}

}  // namespace wagonsight
