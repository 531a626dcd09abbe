#pragma once

#include <optional>
#include <vector>

#include "calibrate/observations.h"
#include "geometry/camera.h"

namespace wagonsight {

// Where the whole board lies in an image of which some corners are known.
struct BoardPrediction {
  std::vector<Corner> corners;  // all of the board, in the order of their IDs
  double rms_px = 0;            // of the known corners' residual lengths
  struct Misfit {
    int id = 0;
    double length_px = 0;
  };
  std::vector<Misfit> misfits;  // known corners, worst first
  bool mirrored = false;        // seen from behind: no camera can, so IDs are counted the wrong way
};

// From four or more corners, no three of the first four on a line: the board's pose when `camera`
// is known (its distortion bends the prediction), else the homography, with one radial term about
// the image's centre from 12 corners on. Nothing when the corners do not span the plane.
std::optional<BoardPrediction> predict_board(const Board& board, const std::vector<Corner>& known,
                                             int width, int height,
                                             const std::optional<Camera>& camera);

// Distance in pixels from corner `id` of a prediction to the nearest one beside it.
double spacing_at(const Board& board, const BoardPrediction& prediction, int id);

}  // namespace wagonsight
