#pragma once

#include <string>
#include <vector>

#include "base/result.h"
#include "calibrate/corner_snap.h"
#include "calibrate/observations.h"

namespace wagonsight {

// What was found of the board in one image.
struct DetectedBoard {
  std::vector<Corner> corners;  // in the order of their IDs
  bool whole = false;           // all of the board's corners
  // A part of the board without enough of its border: the corners hang together, but where on the
  // board they lie must come from other views of the pose (solve() does that) or from clicks.
  bool placed = true;
  std::string why_not_placed;  // a sentence
};

// Finds the board's inner corners with sub-pixel accuracy: whole boards with OpenCV's
// findChessboardCornersSB, boards that are partly hidden, blurred or glared on by growing a grid
// over saddle points (find_grid). IDs follow one convention for every view of every camera: where
// rows + columns is odd, corner 0 is the one beside the board's black corner square; where it is
// even the board looks the same turned by 180 degrees, and corner 0 is the end nearer to the
// image's top left (solve() turns views that contradict the others). The Error says why nothing
// usable was found: no corner, too few, too large a pattern. Deterministic, allocates.
Result<DetectedBoard> detect_board(const GrayImage& image, const Board& board);

}  // namespace wagonsight
