#pragma once

#include <Eigen/Core>
#include <map>
#include <utility>
#include <vector>

#include "calibrate/saddle_points.h"

namespace wagonsight {

// Saddles that form a chessboard's lattice, by whole-numbered place (i, j): i along one side of the
// squares and j along the other, clockwise from it in the image, as the camera sees a board's x and
// y. Where the lattice begins on the board is not known yet.
struct BoardGrid {
  struct Node {
    Eigen::Vector2d pixel;
    std::size_t saddle = 0;
  };
  std::map<std::pair<int, int>, Node> nodes;
  // +1: at even i + j the squares towards (+, +) and (-, -) are the bright ones; -1: the dark ones.
  int bright_at_even = 0;

  int extent_i() const;  // places from the lowest to the highest
  int extent_j() const;
};

// The largest lattice of at most `side_max` places a side: grown from the strongest saddles to
// their neighbours, then across gaps (a bar before the board, glare) by its homography. Empty when
// there is none of six corners or more.
BoardGrid find_grid(const std::vector<SaddlePoint>& saddles, int side_max);

// Where place (i, j) lies, which may be between or beyond the nodes, by the homography of the nodes
// about it. The grid must not be empty.
Eigen::Vector2d position_of(const BoardGrid& grid, double i, double j);

}  // namespace wagonsight
