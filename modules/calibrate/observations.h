#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"

// What a calibration sees: corners of one flat chessboard with their IDs, in the images of several
// imagers. Control side only: everything here allocates.
namespace wagonsight {

// The board defines frame B: origin at inner corner 0, x along a row, y down the columns, z into
// the board as it is looked at (right-handed); metres.
struct Board {
  int rows = 0;  // inner corners
  int columns = 0;
  double square_m = 0;

  int corner_count() const { return rows * columns; }
  // id = row * columns + column, 0 <= id < corner_count().
  Eigen::Vector3d point(int id) const {
    return {square_m * (id % columns), square_m * (id / columns), 0.0};  // NOLINT: whole rows
  }
};

struct Corner {
  int id = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // 0-based, a pixel's centre is an integer
};

struct View {
  std::string imager;  // "k0", or "s0.left" for an imager of a stereo camera
  std::string image;   // file, for the report; may be empty
  std::string pose;    // views with the same name show the same board pose; never empty
  std::vector<Corner> corners;
  // False: the corners hang together, but where on the board they begin is not known; their IDs are
  // one of several possible numberings.
  bool placed = true;
};

struct Observations {
  Board board;
  std::vector<View> views;
};

// Reads OBS.json (see INTERFACES). A view without "pose" gets one of its own. The Error names the
// file, the view and the rule broken: a duplicate or unknown ID, a pixel that is no number, a
// view without corners, a board without size.
Result<Observations> parse_observations(std::string_view json, std::string_view file);
std::string format_observations(const Observations& observations);

}  // namespace wagonsight
