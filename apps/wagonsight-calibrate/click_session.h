#pragma once

#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "calibrate/observations.h"
#include "image_folder.h"

// What a person has clicked: the corners of every image and the targets, saved to their files with
// every edit. Saving comes first: an edit that could not be written did not happen.
namespace wagonsight {

using Json = nlohmann::json;

class ClickSession {
 public:
  struct Files {
    std::string observations, targets;
  };
  // Reads what the files hold already; either may be absent. The Error says which file cannot be
  // used and why; nothing is ever overwritten because it could not be read.
  static Result<ClickSession> open(const Board& board, std::vector<ListedImage> images,
                                   const Files& files);

  const Board& board() const { return board_; }
  const std::vector<ListedImage>& images() const { return images_; }
  // The corners of an image, sorted by ID.
  const std::vector<Corner>& corners(std::size_t image) const { return views_[image].corners; }
  // False: detect could not tell where on the board its corners begin, and nobody has said since.
  bool placed(std::size_t image) const { return views_[image].placed; }
  int revision(std::size_t image) const { return revisions_[image]; }
  const Json& targets() const { return targets_; }  // the list of TARGETS.json
  bool can_undo() const { return !undo_.empty(); }
  bool can_redo() const { return !redo_.empty(); }
  const Files& files() const { return files_; }

  // Replaces all corners of an image, or the list of targets. A corner that is new or elsewhere
  // places the view, and so does a person who confirms it: from then on its IDs are what was said.
  Result<void> set_corners(std::size_t image, std::vector<Corner> corners, bool confirmed = false);
  Result<void> set_targets(Json targets);

  struct Changed {
    std::optional<std::size_t> image;  // absent: the targets
  };
  Result<Changed> undo() { return step(undo_, redo_); }
  Result<Changed> redo() { return step(redo_, undo_); }

 private:
  // What an image or the targets were before an edit.
  struct Before {
    std::optional<std::size_t> image;
    std::vector<Corner> corners;
    bool placed = true;
    Json targets;
  };
  Result<void> read_observations();
  Result<void> read_targets();
  Result<Changed> step(std::deque<Before>& from, std::deque<Before>& to);
  Before current(const std::optional<std::size_t>& image) const;
  Result<void> put(const Before& state);
  void remember(Before before);
  Result<void> save_observations();
  Result<void> save_targets();
  Result<void> save(const std::string& path, const std::string& text, std::string& last_known);

  Board board_;
  std::vector<ListedImage> images_;
  Files files_;
  std::vector<View> views_;     // by image; without corners where there are none yet
  std::vector<int> revisions_;  // by image
  std::vector<View> foreign_;   // views of the file whose image is not in the folder; kept
  Json targets_ = Json::array();
  Json observations_root_, targets_root_;         // keys that are not ours are kept
  std::string observations_text_, targets_text_;  // as last read or written
  std::deque<Before> undo_, redo_;
};

}  // namespace wagonsight
