#pragma once

#include <string>
#include <vector>

#include "calibrate/board_grid.h"
#include "calibrate/detect_board.h"

namespace wagonsight {

// Finds where on the board a grid lies. A plain chessboard carries no IDs, so the place follows
// from what is seen of its outline: a grid as long as the board, or the bright margin behind the
// outermost squares. The colours tell the board's ends apart where rows + columns is odd.
// `corners` of the result are the grid's, placed=false (with the first of the possible places)
// where several places remain.
DetectedBoard place_grid(const BoardGrid& grid, const Board& board, const GrayImage& image);

}  // namespace wagonsight
