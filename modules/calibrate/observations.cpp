#include "calibrate/observations.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

namespace wagonsight {
namespace {

using Json = nlohmann::json;

// Ten thousand views of a hundred corners fit; more is a mistake and would only exhaust memory.
constexpr std::size_t kViewsMax = 20'000;
constexpr int kBoardSideMax = 200;

Result<Board> parse_board(const Json& root, std::string_view file) {
  if (!root.contains("board") || !root["board"].is_object())
    return fail(fmt::format("{}: \"board\" with rows, columns and square_m is missing", file));
  const Json& json = root["board"];
  Board board;
  for (const auto& [key, side] : {std::pair{"rows", &board.rows}, {"columns", &board.columns}}) {
    if (!json.contains(key) || !json[key].is_number_integer())
      return fail(fmt::format("{}: board.{} must be a whole number of inner corners", file, key));
    const auto value = json[key].get<std::int64_t>();
    if (value < 2 || value > kBoardSideMax)
      return fail(fmt::format("{}: board.{} = {} must lie between 2 and {}", file, key, value,
                              kBoardSideMax));
    *side = static_cast<int>(value);
  }
  if (!json.contains("square_m") || !json["square_m"].is_number())
    return fail(fmt::format("{}: board.square_m must be a length in metres", file));
  board.square_m = json["square_m"].get<double>();
  if (!(board.square_m > 1e-4 && board.square_m < 10))
    return fail(fmt::format("{}: board.square_m = {} must lie between 0.0001 and 10 metres", file,
                            board.square_m));
  return board;
}

Result<Corner> parse_corner(const Json& json, const Board& board, const std::string& where) {
  if (!json.is_object() || !json.contains("id") || !json["id"].is_number_integer())
    return fail(fmt::format("{}: a corner needs a whole-numbered \"id\"", where));
  const auto id = json["id"].get<std::int64_t>();
  if (id < 0 || id >= board.corner_count())
    return fail(fmt::format("{}: corner {} is not on the board (0 to {})", where, id,
                            board.corner_count() - 1));
  Corner corner;
  corner.id = static_cast<int>(id);
  for (const auto& [key, axis] : {std::pair{"x", 0}, {"y", 1}}) {
    if (!json.contains(key) || !json[key].is_number() || !std::isfinite(json[key].get<double>()))
      return fail(fmt::format("{}: corner {} has no finite \"{}\"", where, id, key));
    corner.pixel[axis] = json[key].get<double>();
  }
  return corner;
}

Result<View> parse_view(const Json& json, std::size_t index, const Board& board,
                        std::string_view file) {
  std::string where = fmt::format("{}: view {}", file, index);
  if (!json.is_object() || !json.contains("sensor") || !json["sensor"].is_string())
    return fail(where + ": \"sensor\" is missing");
  View view;
  view.imager = json["sensor"].get<std::string>();
  if (json.contains("image") && json["image"].is_string())
    view.image = json["image"].get<std::string>();
  view.pose = json.contains("pose") && json["pose"].is_string() ? json["pose"].get<std::string>()
                                                                : std::string();
  if (view.pose.empty()) view.pose = fmt::format("view {}", index);
  where += fmt::format(" ({}{}{})", view.imager, view.image.empty() ? "" : ", ", view.image);
  view.placed = json.value("placed", Json()) != false;
  if (!json.contains("corners") || !json["corners"].is_array() || json["corners"].empty())
    return fail(where + ": it has no corners; remove the view or click its corners");
  std::set<int> seen;
  for (const Json& item : json["corners"]) {
    auto corner = parse_corner(item, board, where);
    if (!corner) return fail(corner.error().message);
    if (!seen.insert(corner->id).second)
      return fail(fmt::format("{}: corner {} stands there twice", where, corner->id));
    view.corners.push_back(*corner);
  }
  return view;
}

}  // namespace

Result<Observations> parse_observations(std::string_view text, std::string_view file) {
  const Json root = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (root.is_discarded() || !root.is_object())
    return fail(fmt::format("{}: this is not JSON", file));
  auto board = parse_board(root, file);
  if (!board) return fail(board.error().message);
  if (!root.contains("views") || !root["views"].is_array() || root["views"].empty())
    return fail(fmt::format("{}: \"views\" is missing or empty", file));
  if (root["views"].size() > kViewsMax)
    return fail(fmt::format("{}: {} views are more than the {} that can be solved at once", file,
                            root["views"].size(), kViewsMax));
  Observations observations;
  observations.board = *board;
  std::set<std::pair<std::string, std::string>> told;
  for (std::size_t i = 0; i < root["views"].size(); ++i) {
    auto view = parse_view(root["views"][i], i, *board, file);
    if (!view) return fail(view.error().message);
    if (!told.insert({view->imager, view->pose}).second)
      return fail(fmt::format("{}: view {}: {} shows the board pose \"{}\" twice", file, i,
                              view->imager, view->pose));
    observations.views.push_back(std::move(*view));
  }
  return observations;
}

std::string format_observations(const Observations& observations) {
  Json root;
  root["board"] = {{"rows", observations.board.rows},
                   {"columns", observations.board.columns},
                   {"square_m", observations.board.square_m}};
  root["views"] = Json::array();
  for (const View& view : observations.views) {
    Json corners = Json::array();
    for (const Corner& corner : view.corners)
      corners.push_back({{"id", corner.id}, {"x", corner.pixel.x()}, {"y", corner.pixel.y()}});
    root["views"].push_back({{"sensor", view.imager},
                             {"image", view.image},
                             {"pose", view.pose},
                             {"corners", std::move(corners)}});
    if (!view.placed) root["views"].back()["placed"] = false;
  }
  return root.dump(1) + "\n";
}

}  // namespace wagonsight
