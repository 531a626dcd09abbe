#include "click_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "commands.h"
#include "linux/files.h"

namespace wagonsight {
namespace {

constexpr std::size_t kUndoMax = 1000;
constexpr double kMoved_px = 1e-4;  // the page rounds what it sends back to 1e-5

bool exists(const std::string& path) {
  std::error_code error;
  return std::filesystem::exists(path, error);
}

void sort_by_id(std::vector<Corner>& corners) {
  std::sort(corners.begin(), corners.end(),
            [](const Corner& a, const Corner& b) { return a.id < b.id; });
}

// A person who adds a corner or moves one says by its ID where on the board it is; who only takes
// some away does not.
bool says_where(const std::vector<Corner>& before, const std::vector<Corner>& after) {
  return std::any_of(after.begin(), after.end(), [&](const Corner& corner) {
    return std::none_of(before.begin(), before.end(), [&](const Corner& old) {
      return old.id == corner.id && (old.pixel - corner.pixel).norm() < kMoved_px;
    });
  });
}

}  // namespace

Result<ClickSession> ClickSession::open(const Board& board, std::vector<ListedImage> images,
                                        const Files& files) {
  ClickSession session;
  session.board_ = board;
  session.images_ = std::move(images);
  session.files_ = files;
  session.revisions_.resize(session.images_.size());
  for (const ListedImage& image : session.images_)
    session.views_.push_back({image.sensor, image.name, image.stem, {}});
  if (auto read = session.read_observations(); !read) return fail(read.error().message);
  if (auto read = session.read_targets(); !read) return fail(read.error().message);
  return session;
}

Result<void> ClickSession::read_observations() {
  const std::string& path = files_.observations;
  observations_root_ = Json::object();
  if (!exists(path)) return {};
  auto text = read_file(path, kFileBytesMax);
  if (!text) return fail(text.error().message);
  observations_text_ = *text;
  observations_root_ = Json::parse(*text, nullptr, false);
  if (!observations_root_.is_object())
    return fail(fmt::format("{}: this is not JSON; move it away or name another file", path));
  const Json views = observations_root_.value("views", Json::array());
  if (views.is_array() && views.empty()) return {};  // all corners were taken away again
  const auto read = parse_observations(*text, path);
  if (!read) return fail(read.error().message);
  if (read->board.rows != board_.rows || read->board.columns != board_.columns)
    return fail(fmt::format("{}: its board has {} x {} corners, the board file says {} x {}", path,
                            read->board.rows, read->board.columns, board_.rows, board_.columns));
  for (const View& view : read->views) {
    const auto image =
        std::find_if(images_.begin(), images_.end(), [&](const ListedImage& candidate) {
          return candidate.sensor == view.imager && candidate.name == view.image;
        });
    if (image == images_.end()) {
      foreign_.push_back(view);
      continue;
    }
    const auto index = static_cast<std::size_t>(image - images_.begin());
    views_[index] = view;
    sort_by_id(views_[index].corners);
  }
  return {};
}

Result<void> ClickSession::read_targets() {
  targets_root_ = Json::object();
  if (!exists(files_.targets)) return {};
  auto text = read_file(files_.targets, kFileBytesMax);
  if (!text) return fail(text.error().message);
  targets_text_ = *text;
  targets_root_ = Json::parse(*text, nullptr, false);
  const Json list =
      targets_root_.is_object() ? targets_root_.value("targets", Json::array()) : Json();
  const bool sound = list.is_array() && std::all_of(list.begin(), list.end(), [](const Json& t) {
                       return t.is_object() && t.contains("id") && t["id"].is_string() &&
                              t.value("seen", Json::array()).is_array();
                     });
  if (!sound)
    return fail(
        fmt::format("{}: this is not a JSON object with \"targets\" that have an \"id\"; "
                    "move it away or name another file",
                    files_.targets));
  targets_ = list;
  return {};
}

ClickSession::Before ClickSession::current(const std::optional<std::size_t>& image) const {
  if (image) return {image, views_[*image].corners, views_[*image].placed, {}};
  return {image, {}, true, targets_};
}

Result<void> ClickSession::put(const Before& state) {
  Before was = current(state.image);
  if (state.image) {
    views_[*state.image].corners = state.corners;
    views_[*state.image].placed = state.placed;
    ++revisions_[*state.image];
  } else {
    targets_ = state.targets;
  }
  auto saved = state.image ? save_observations() : save_targets();
  if (saved) return saved;
  if (was.image) {
    views_[*was.image].corners = std::move(was.corners);
    views_[*was.image].placed = was.placed;
  } else {
    targets_ = std::move(was.targets);
  }
  return saved;
}

void ClickSession::remember(Before before) {
  if (undo_.size() == kUndoMax) undo_.pop_front();
  undo_.push_back(std::move(before));
  redo_.clear();
}

Result<void> ClickSession::set_corners(std::size_t image, std::vector<Corner> corners,
                                       bool confirmed) {
  sort_by_id(corners);
  Before before = current(image);
  const bool placed = before.placed || confirmed || says_where(before.corners, corners);
  if (auto done = put({image, std::move(corners), placed, {}}); !done) return done;
  remember(std::move(before));
  return {};
}

Result<void> ClickSession::set_targets(Json targets) {
  Before before = current(std::nullopt);
  if (auto done = put({std::nullopt, {}, true, std::move(targets)}); !done) return done;
  remember(std::move(before));
  return {};
}

Result<ClickSession::Changed> ClickSession::step(std::deque<Before>& from, std::deque<Before>& to) {
  if (from.empty()) return fail("there is nothing to undo or redo");
  Before now = current(from.back().image);
  if (auto done = put(from.back()); !done) return fail(done.error().message);
  const Changed changed{from.back().image};
  from.pop_back();
  to.push_back(std::move(now));
  return changed;
}

Result<void> ClickSession::save(const std::string& path, const std::string& text,
                                std::string& last_known) {
  if (exists(path)) {
    const auto there = read_file(path, kFileBytesMax);
    if (!there) return fail(there.error().message);
    if (*there != last_known)
      return fail(
          fmt::format("{} was changed by another program; end this tool and start it again "
                      "so that neither work is lost",
                      path));
  }
  if (auto written = write_file_durably(path, bytes_of(text)); !written) return written;
  last_known = text;
  return {};
}

Result<void> ClickSession::save_observations() {
  Observations all{board_, {}};
  for (const View& view : views_)
    if (!view.corners.empty()) all.views.push_back(view);
  all.views.insert(all.views.end(), foreign_.begin(), foreign_.end());
  const Json ours = Json::parse(format_observations(all));
  for (const auto& [key, value] : ours.items()) observations_root_[key] = value;
  return save(files_.observations, observations_root_.dump(1) + "\n", observations_text_);
}

Result<void> ClickSession::save_targets() {
  targets_root_["targets"] = targets_;
  return save(files_.targets, targets_root_.dump(1) + "\n", targets_text_);
}

}  // namespace wagonsight
