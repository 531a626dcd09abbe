#include "click_site.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <random>
#include <set>

#include "calibrate/ball_centre.h"
#include "calibrate/board_prediction.h"
#include "click_page.h"
#include "http/local_page.h"

namespace wagonsight {
namespace {

ServerAnswer json_answer(const Json& json) {
  ServerAnswer answer;
  answer.content_type = "application/json";
  answer.body = json.dump(-1, ' ', false, Json::error_handler_t::replace);
  answer.headers = {{"Cache-Control", "no-store"}, {"X-Content-Type-Options", "nosniff"}};
  return answer;
}

std::optional<std::size_t> image_index(const Json& asked, std::size_t count) {
  const Json index = asked.is_object() ? asked.value("image", Json()) : Json();
  if (!index.is_number_unsigned() || index.get<std::uint64_t>() >= count) return std::nullopt;
  return index.get<std::size_t>();
}

std::optional<double> number(const Json& asked, const char* key) {
  const Json value = asked.value(key, Json());
  if (!value.is_number() || !std::isfinite(value.get<double>())) return std::nullopt;
  return value.get<double>();
}

std::optional<Eigen::Vector2d> pixel_of(const Json& asked) {
  const auto x = number(asked, "x"), y = number(asked, "y");
  if (!x || !y) return std::nullopt;
  return Eigen::Vector2d(*x, *y);
}

// Hundredths of a thousandth of a pixel are enough, and keep the files short.
double rounded(double pixel) {
  return std::round(pixel * 1e5) / 1e5;
}

Json to_json(const Corner& corner) {
  return {{"id", corner.id}, {"x", rounded(corner.pixel.x())}, {"y", rounded(corner.pixel.y())}};
}

int half_window(double spacing) {
  return std::clamp(static_cast<int>(spacing / 3), 2, 8);
}

bool within(const Eigen::Vector2d& pixel, const LoadedImage& image) {
  return pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() <= image.width - 1 &&
         pixel.y() <= image.height - 1;
}

std::string random_word() {
  std::random_device source;
  return fmt::format("{:08x}{:08x}{:08x}{:08x}", source(), source(), source(), source());
}

// The corners of one photograph look much alike; where a hand's rim crosses a square's edge the
// saddle is weaker than they are.
std::vector<int> drop_weak(const std::map<int, double>& strengths, std::vector<Corner>& corners) {
  constexpr double kShare = 0.5;  // of the median
  std::vector<double> sorted;
  sorted.reserve(strengths.size());
  for (const auto& [id, strength] : strengths) sorted.push_back(strength);
  std::sort(sorted.begin(), sorted.end());
  std::vector<int> dropped;
  for (const auto& [id, strength] : strengths)
    if (strength < kShare * sorted[sorted.size() / 2]) dropped.push_back(id);
  std::erase_if(corners, [&](const Corner& corner) {
    return std::find(dropped.begin(), dropped.end(), corner.id) != dropped.end();
  });
  return dropped;
}

// The first corners were clicked before anything told how far apart they lie, with a window that
// may have reached across their neighbours: they snap anew where that agrees better with the board.
std::size_t snap_anew(const LoadedImage& pixels, const Board& board,
                      const std::optional<Camera>& camera, std::vector<Corner>& corners) {
  const auto prediction = predict_board(board, corners, pixels.width, pixels.height, camera);
  if (!prediction) return 0;
  std::size_t moved = 0;
  for (Corner& corner : corners) {
    const Eigen::Vector2d expected = prediction->corners[static_cast<std::size_t>(corner.id)].pixel;
    const double spacing = spacing_at(board, *prediction, corner.id);
    const auto found = snap_to_saddle(pixels.view(), corner.pixel,
                                      std::clamp(0.28 * spacing, 1.5, 8.0), half_window(spacing));
    if (!found || (found->pixel - expected).norm() >= (corner.pixel - expected).norm()) continue;
    corner.pixel = found->pixel;
    ++moved;
  }
  return moved;
}

ServerAnswer stale() {
  return sentence_answer(409, "Another page changed this image meanwhile; it is shown anew.");
}

}  // namespace

ClickSite::ClickSite(ClickSession session, std::map<std::string, Camera> cameras,
                     std::uint16_t port)
    : session_(std::move(session)), cameras_(std::move(cameras)), port_(port) {}

ServerAnswer ClickSite::refuse(int status) {
  return sentence_answer(status, "This request cannot be served.");
}

ServerAnswer ClickSite::answer(const ServerRequest& request) {
  if (auto refused = refuse_unless_own_page(request, port_)) return *refused;
  const std::size_t mark = std::min(request.target.find('?'), request.target.size());
  const std::string path = request.target.substr(0, mark);
  const std::string query =
      mark < request.target.size() ? request.target.substr(mark + 1) : std::string();
  if (request.method == "GET" || request.method == "HEAD") return get(path, query);
  if (request.method != "POST")
    return sentence_answer(405, "Only GET and POST are understood here.");
  const Json asked = Json::parse(request.body, nullptr, false);
  if (!asked.is_object()) return sentence_answer(400, "The body must be a JSON object.");
  return post(path, asked);
}

ServerAnswer ClickSite::page() const {
  ServerAnswer answer;
  answer.content_type = "text/html; charset=utf-8";
  const std::string nonce = random_word();
  answer.body = click_page::kHtml;
  const auto put = [&](std::string_view mark, const std::string& text) {
    const std::size_t at = answer.body.find(mark);
    if (at != std::string::npos) answer.body.replace(at, mark.size(), text);
  };
  put("<!--style-->", fmt::format("<style>{}</style>", click_page::kStyle));
  put("<!--script-->", fmt::format("<script nonce=\"{}\">{}</script>", nonce, click_page::kScript));
  answer.headers = {
      {"Content-Security-Policy",
       fmt::format("default-src 'none'; style-src 'unsafe-inline'; script-src 'nonce-{}'; "
                   "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
                   "frame-ancestors 'none'",
                   nonce)},
      {"Cache-Control", "no-store"},
      {"X-Content-Type-Options", "nosniff"},
      {"Referrer-Policy", "no-referrer"}};
  return answer;
}

ServerAnswer ClickSite::get(const std::string& path, const std::string& query) {
  if (path == "/") return page();
  if (path == "/api/state") return state();
  if (path == "/favicon.ico") return {204, {}, {}, {}, false};
  if (path != "/api/view" && path != "/api/image")
    return sentence_answer(404, "There is no such page here.");
  constexpr std::string_view kKey = "image=";
  std::size_t image = session_.images().size();
  if (query.starts_with(kKey))
    std::from_chars(query.data() + kKey.size(), query.data() + query.size(), image);
  if (image >= session_.images().size()) return sentence_answer(404, "There is no such image.");
  return path == "/api/view" ? view(image) : picture(image);
}

ServerAnswer ClickSite::post(const std::string& path, const Json& asked) {
  if (path == "/api/undo") return step(true);
  if (path == "/api/redo") return step(false);
  if (path == "/api/targets") return targets(asked);
  const auto image = image_index(asked, session_.images().size());
  if (!image) return sentence_answer(404, "There is no such image.");
  if (path == "/api/snap") return snap(*image, asked);
  if (path == "/api/edit") return edit(*image, asked);
  if (path == "/api/accept") return accept(*image, asked);
  if (path == "/api/ball") return ball(*image, asked);
  return sentence_answer(404, "There is no such page here.");
}

ServerAnswer ClickSite::state() const {
  Json images = Json::array();
  for (std::size_t i = 0; i < session_.images().size(); ++i)
    images.push_back({{"sensor", session_.images()[i].sensor},
                      {"name", session_.images()[i].name},
                      {"corners", session_.corners(i).size()}});
  return json_answer({{"board",
                       {{"rows", session_.board().rows},
                        {"columns", session_.board().columns},
                        {"square_m", session_.board().square_m}}},
                      {"observations", session_.files().observations},
                      {"targets_file", session_.files().targets},
                      {"images", std::move(images)},
                      {"targets", session_.targets()},
                      {"undo", session_.can_undo()},
                      {"redo", session_.can_redo()}});
}

std::optional<Camera> ClickSite::camera_of(std::size_t image) const {
  const std::string& sensor = session_.images()[image].sensor;
  const auto camera = cameras_.find(sensor);
  if (camera == cameras_.end()) return std::nullopt;
  return camera->second;
}

Json ClickSite::view_json(std::size_t image, const LoadedImage& pixels) const {
  Json corners = Json::array();
  for (const Corner& corner : session_.corners(image)) corners.push_back(to_json(corner));
  Json told = {{"image", image},
               {"revision", session_.revision(image)},
               {"width", pixels.width},
               {"height", pixels.height},
               {"placed", session_.placed(image)},
               {"corners", std::move(corners)},
               {"undo", session_.can_undo()},
               {"redo", session_.can_redo()}};
  const auto prediction = predict_board(session_.board(), session_.corners(image), pixels.width,
                                        pixels.height, camera_of(image));
  if (!prediction) return told;
  std::set<int> known;
  for (const Corner& corner : session_.corners(image)) known.insert(corner.id);
  Json rest = Json::array();
  for (const Corner& corner : prediction->corners)
    if (!known.contains(corner.id) && within(corner.pixel, pixels)) {
      rest.push_back(to_json(corner));
      rest.back()["spacing"] = spacing_at(session_.board(), *prediction, corner.id);
    }
  Json misfits = Json::array();
  for (const auto& misfit : prediction->misfits)
    misfits.push_back({{"id", misfit.id}, {"length", rounded(misfit.length_px)}});
  told["prediction"] = {{"corners", std::move(rest)},
                        {"rms", prediction->rms_px},
                        {"misfits", std::move(misfits)},
                        {"mirrored", prediction->mirrored}};
  return told;
}

ServerAnswer ClickSite::view(std::size_t image) {
  const auto pixels = cache_.get(session_.images()[image]);
  if (!pixels) return sentence_answer(422, pixels.error().message);
  return json_answer(view_json(image, **pixels));
}

ServerAnswer ClickSite::picture(std::size_t image) {
  const auto pixels = cache_.get(session_.images()[image]);
  if (!pixels) return sentence_answer(422, pixels.error().message);
  ServerAnswer answer;
  answer.content_type = "image/png";
  answer.body = to_png(**pixels);
  answer.headers = {{"Cache-Control", "private, max-age=600"},
                    {"X-Content-Type-Options", "nosniff"}};
  return answer;
}

ServerAnswer ClickSite::snap(std::size_t image, const Json& asked) {
  const auto near = pixel_of(asked);
  const auto radius = number(asked, "radius");
  if (!near || !radius || !(*radius > 0 && *radius <= 40))
    return sentence_answer(400, "x, y and a radius of at most 40 pixels are needed.");
  const auto pixels = cache_.get(session_.images()[image]);
  if (!pixels) return sentence_answer(422, pixels.error().message);
  double spacing = 20;  // until four corners tell
  if (const auto prediction =
          predict_board(session_.board(), session_.corners(image), (*pixels)->width,
                        (*pixels)->height, camera_of(image))) {
    double nearest = 1e9;
    for (const Corner& corner : prediction->corners) {
      const double distance = (corner.pixel - *near).norm();
      if (distance < nearest)
        nearest = distance, spacing = spacing_at(session_.board(), *prediction, corner.id);
    }
  }
  const auto found =
      snap_to_saddle((*pixels)->view(), *near, std::min(*radius, std::max(2.5, 0.45 * spacing)),
                     half_window(spacing));
  if (!found) return json_answer({{"found", false}});
  return json_answer({{"found", true},
                      {"x", rounded(found->pixel.x())},
                      {"y", rounded(found->pixel.y())},
                      {"strength", found->strength}});
}

ServerAnswer ClickSite::edit(std::size_t image, const Json& asked) {
  if (asked.value("revision", Json()) != session_.revision(image)) return stale();
  const auto pixels = cache_.get(session_.images()[image]);
  if (!pixels) return sentence_answer(422, pixels.error().message);
  const Json list = asked.value("corners", Json());
  if (!list.is_array()) return sentence_answer(400, "The list of corners is missing.");
  std::vector<Corner> corners;
  std::set<int> seen;
  for (const Json& item : list) {
    const Json id = item.is_object() ? item.value("id", Json()) : Json();
    const auto pixel = item.is_object() ? pixel_of(item) : std::nullopt;
    if (!id.is_number_unsigned() ||
        id.get<std::uint64_t>() >= static_cast<std::uint64_t>(session_.board().corner_count()))
      return sentence_answer(400, "A corner's ID is not on the board.");
    if (!pixel || !within(*pixel, **pixels))
      return sentence_answer(400, fmt::format("Corner {} lies outside of the image.", id.dump()));
    if (!seen.insert(id.get<int>()).second)
      return sentence_answer(400, fmt::format("Corner {} stands there twice.", id.dump()));
    corners.push_back({id.get<int>(), *pixel});
  }
  if (auto done = session_.set_corners(image, std::move(corners)); !done)
    return sentence_answer(507, done.error().message);
  return json_answer(view_json(image, **pixels));
}

// A saddle that a hand's rim makes with a square lies near its corner but not at it: what was just
// added and does not fit the board that all corners agree on is taken away again.
std::set<int> ClickSite::drop_misfits(std::size_t image, const LoadedImage& pixels,
                                      std::vector<Corner>& corners) const {
  std::set<int> clicked, dropped;
  for (const Corner& corner : session_.corners(image)) clicked.insert(corner.id);
  for (int round = 0; round < 3; ++round) {
    const auto all =
        predict_board(session_.board(), corners, pixels.width, pixels.height, camera_of(image));
    if (!all) break;
    const double median = all->misfits[all->misfits.size() / 2].length_px;
    const double limit = std::max(0.6, 4 * median);
    const auto worst =
        std::find_if(all->misfits.begin(), all->misfits.end(),
                     [&](const auto& misfit) { return !clicked.contains(misfit.id); });
    if (worst == all->misfits.end() || worst->length_px < limit) break;
    for (const auto& misfit : all->misfits)
      if (misfit.length_px >= std::max(limit, 0.7 * worst->length_px) &&
          !clicked.contains(misfit.id)) {
        dropped.insert(misfit.id);
        std::erase_if(corners, [&](const Corner& corner) { return corner.id == misfit.id; });
      }
  }
  return dropped;
}

ServerAnswer ClickSite::accept(std::size_t image, const Json& asked) {
  if (asked.value("revision", Json()) != session_.revision(image)) return stale();
  const auto pixels = cache_.get(session_.images()[image]);
  if (!pixels) return sentence_answer(422, pixels.error().message);
  std::vector<Corner> corners = session_.corners(image);
  const std::size_t before = corners.size();
  std::set<int> refused;
  std::map<int, double> strengths;  // of what was added
  // Corners that were just taken straighten the prediction, so that those beyond them come within
  // reach; three rounds from the middle outwards settle it.
  for (int round = 0; round < 3; ++round) {
    const auto prediction = predict_board(session_.board(), corners, (*pixels)->width,
                                          (*pixels)->height, camera_of(image));
    if (!prediction)
      return sentence_answer(422, "Four corners that are not on one line come first.");
    if (prediction->mirrored)
      return sentence_answer(
          422, "The IDs run the wrong way round: the board would be seen from behind.");
    std::set<int> known;
    for (const Corner& corner : corners) known.insert(corner.id);
    refused.clear();
    std::size_t added = 0;
    for (const Corner& expected : prediction->corners) {
      if (known.contains(expected.id) || !within(expected.pixel, **pixels)) continue;
      const double spacing = spacing_at(session_.board(), *prediction, expected.id);
      const auto found = snap_to_saddle((*pixels)->view(), expected.pixel,
                                        std::clamp(0.28 * spacing, 1.5, 8.0), half_window(spacing));
      if (found)
        corners.push_back({expected.id, found->pixel}), ++added,
            strengths[expected.id] = found->strength;
      else
        refused.insert(expected.id);
    }
    if (added == 0) break;
  }
  for (const int id : drop_weak(strengths, corners)) refused.insert(id);
  for (const int id : drop_misfits(image, **pixels, corners)) refused.insert(id);
  const std::size_t added = corners.size() - before;
  const std::size_t moved = snap_anew(**pixels, session_.board(), camera_of(image), corners);
  if (moved > 0 || added > 0 || !session_.placed(image))
    if (auto done = session_.set_corners(image, std::move(corners), true); !done)
      return sentence_answer(507, done.error().message);
  Json told = view_json(image, **pixels);
  told["added"] = added;
  told["refused"] = refused;
  return json_answer(told);
}

ServerAnswer ClickSite::ball(std::size_t image, const Json& asked) {
  const auto near = pixel_of(asked);
  if (!near) return sentence_answer(400, "x and y are needed.");
  const auto pixels = cache_.get(session_.images()[image]);
  if (!pixels) return sentence_answer(422, pixels.error().message);
  const double radius_max = std::min(120.0, (*pixels)->height / 4.0);
  const auto found = fit_ball_outline((*pixels)->view(), *near, radius_max);
  if (!found) return json_answer({{"found", false}});
  // Off the axis the middle of the outline is not where the ball's middle is seen.
  Eigen::Vector2d centre = found->centre;
  if (const auto camera = camera_of(image))
    if (const auto corrected = ball_centre(*camera, *found)) centre = corrected->pixel;
  return json_answer(
      {{"found", true},
       {"x", rounded(centre.x())},
       {"y", rounded(centre.y())},
       {"corrected", (centre - found->centre).norm()},
       {"outline",
        {rounded(found->semi_axes_px[0]), rounded(found->semi_axes_px[1]), rounded(found->angle),
         rounded(found->centre.x()), rounded(found->centre.y())}},
       {"rms", found->rms_px},
       {"seen", found->seen_share}});
}

ServerAnswer ClickSite::targets(const Json& asked) {
  const Json list = asked.value("targets", Json());
  if (!list.is_array() || list.size() > 1000)
    return sentence_answer(400, "The list of targets is missing.");
  std::set<std::string> ids;
  for (const Json& target : list) {
    const Json id = target.is_object() ? target.value("id", Json()) : Json();
    if (!id.is_string() || id.get<std::string>().empty() || id.get<std::string>().size() > 40)
      return sentence_answer(400, "A target needs a name of 1 to 40 letters.");
    if (!ids.insert(id.get<std::string>()).second)
      return sentence_answer(400, fmt::format("Target {} stands there twice.", id.dump()));
    const Json seen = target.value("seen", Json::array());
    const bool sound =
        seen.is_array() && std::all_of(seen.begin(), seen.end(), [](const Json& s) {
          return s.is_object() && s.value("sensor", Json()).is_string() && pixel_of(s).has_value();
        });
    if (!sound)
      return sentence_answer(400, fmt::format("Target {}: a sighting has no pixel.", id.dump()));
  }
  if (auto done = session_.set_targets(list); !done)
    return sentence_answer(507, done.error().message);
  return state();
}

ServerAnswer ClickSite::step(bool back) {
  const auto changed = back ? session_.undo() : session_.redo();
  if (!changed) return sentence_answer(409, changed.error().message);
  Json told = {{"targets", session_.targets()},
               {"undo", session_.can_undo()},
               {"redo", session_.can_redo()}};
  if (changed->image) told["image"] = *changed->image;
  return json_answer(told);
}

}  // namespace wagonsight
