#include "calibrate/markers.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

namespace wagonsight {
namespace {

using Json = nlohmann::json;

// The numbers between the next '[' and ']' of a line; false at its end or where they are none.
bool next_numbers(std::string_view& line, std::vector<double>& numbers) {
  numbers.clear();
  const std::size_t open = line.find('['), close = line.find(']');
  if (open == std::string_view::npos || close == std::string_view::npos || close < open)
    return false;
  std::string_view inside = line.substr(open + 1, close - open - 1);
  line.remove_prefix(close + 1);
  while (true) {
    while (!inside.empty() && inside.front() == ' ') inside.remove_prefix(1);
    if (inside.empty()) return !numbers.empty();
    double value = 0;
    const auto [end, error] = std::from_chars(inside.data(), inside.data() + inside.size(), value);
    if (error != std::errc() || !std::isfinite(value)) return false;
    numbers.push_back(value);
    inside.remove_prefix(static_cast<std::size_t>(end - inside.data()));
  }
}

struct Track {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero(), first = Eigen::Vector3d::Zero();
  int frames = 0;
};

Result<void> add(std::map<std::string, Track>& tracks, const std::string& name,
                 const Eigen::Vector3d& position, const std::string& where) {
  constexpr double kStill_m = 0.005;
  Track& track = tracks[name];
  if (track.frames++ == 0) track.first = position;
  track.sum += position;
  const double moved = (position - track.first).norm();
  if (moved > kStill_m)
    return fail(fmt::format("{}: marker {} moved by {:.1f} mm; record the targets standing still",
                            where, name, moved * 1e3));
  return {};
}

// One "3d" or "6d" line: its kind and count, then for each the number and quality and the
// position in brackets (a body's rotation follows in brackets of its own).
Result<void> read_line(std::string_view line, const std::string& where,
                       std::map<std::string, Track>& tracks) {
  const bool markers = line.starts_with("3d "), bodies = line.starts_with("6d ");
  if (!markers && !bodies) return {};
  std::vector<double> name, position, rotation;
  while (line.find('[') != std::string_view::npos) {
    const bool read = next_numbers(line, name) && next_numbers(line, position) &&
                      (markers || next_numbers(line, rotation));
    if (!read || name.size() != 2 || position.size() != (markers ? 3U : 6U))
      return fail(where + ": this is not [id quality][x y z] as DTrack writes it");
    const int id = static_cast<int>(name[0]);
    const Eigen::Vector3d metres(1e-3 * position[0], 1e-3 * position[1], 1e-3 * position[2]);
    auto added =
        add(tracks, markers ? fmt::format("{}", id) : fmt::format("6d/{}", id), metres, where);
    if (!added) return added;
  }
  return {};
}

Result<Markers> read_json(std::string_view text, std::string_view file) {
  const Json root = Json::parse(text, nullptr, false);
  if (!root.is_object())
    return fail(
        fmt::format("{}: this is neither JSON {{\"name\": [x, y, z]}} nor DTrack's text", file));
  Markers markers;
  for (const auto& [name, json] : root.items()) {
    Eigen::Vector3d& position = markers[name];
    for (std::size_t i = 0; i < 3; ++i) {
      if (!json.is_array() || json.size() != 3 || !json[i].is_number() ||
          !std::isfinite(json[i].get<double>()))
        return fail(fmt::format("{}: {} must be three finite numbers in metres", file, name));
      position[static_cast<Eigen::Index>(i)] = json[i].get<double>();
    }
  }
  return markers;
}

}  // namespace

Result<Markers> parse_markers(std::string_view text, std::string_view file) {
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  if (first != std::string_view::npos && text[first] == '{') return read_json(text, file);
  std::map<std::string, Track> tracks;
  int number = 0;
  while (!text.empty()) {
    std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), line.size() + 1));
    if (line.ends_with('\r')) line.remove_suffix(1);
    auto read = read_line(line, fmt::format("{}:{}", file, ++number), tracks);
    if (!read) return fail(read.error().message);
  }
  if (tracks.empty())
    return fail(fmt::format("{}: it holds no marker: no \"3d\" or \"6d\" line of DTrack", file));
  Markers markers;
  for (const auto& [name, track] : tracks) markers[name] = track.sum / track.frames;
  return markers;
}

}  // namespace wagonsight
