#include "calibrate/board_placement.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace wagonsight {
namespace {

// The grid's four sides in the order i low, i high, j low, j high.
struct Outline {
  int low_i = 0, high_i = 0, low_j = 0, high_j = 0;
  std::array<bool, 4> border{};   // the board ends behind this side
  std::array<bool, 4> goes_on{};  // it does not: there are squares behind the outermost ones
};

// A quarter turn of the grid onto the board: place (i, j) becomes column and row.
struct Turn {
  int ii, ij, ji, jj;  // column = ii i + ij j, row = ji i + jj j
};
constexpr std::array<Turn, 4> kTurns = {
    {{1, 0, 0, 1}, {0, 1, -1, 0}, {-1, 0, 0, -1}, {0, -1, 1, 0}}};

struct Placement {
  int turn = 0, column = 0, row = 0;  // added after the turn
};

std::pair<int, int> on_board(const Placement& placement, const std::pair<int, int>& place) {
  const Turn& t = kTurns[static_cast<std::size_t>(placement.turn)];
  return {t.ii * place.first + t.ij * place.second + placement.column,
          t.ji * place.first + t.jj * place.second + placement.row};
}

std::optional<double> brightness(const GrayImage& image, const Eigen::Vector2d& pixel) {
  if (!pixel.allFinite() || pixel.x() < 1 || pixel.y() < 1 || pixel.x() > image.width - 2 ||
      pixel.y() > image.height - 2)
    return std::nullopt;
  double sum = 0;
  for (int dv = -1; dv <= 1; ++dv)
    for (int du = -1; du <= 1; ++du)
      sum += image.at(static_cast<int>(std::lround(pixel.x())) + du,
                      static_cast<int>(std::lround(pixel.y())) + dv);
  return sum / 9;
}

// Does the board end behind a side? Along the side the outermost squares must be whole (dark and
// bright in turn up to their outer edge) and behind them the bright margin must lie; a hand or a
// bar in front of the board covers the squares somewhere, not along their edge.
bool is_border(const BoardGrid& grid, const GrayImage& image, bool side_of_i, int at, int outward) {
  const auto position = [&](double across, double along) {
    return side_of_i ? position_of(grid, at + outward * across, along)
                     : position_of(grid, along, at + outward * across);
  };
  int shown = 0, contradicted = 0;
  for (const auto& [place, node] : grid.nodes) {
    if ((side_of_i ? place.first : place.second) != at) continue;
    const int along = side_of_i ? place.second : place.first;
    // Both squares that touch beyond this corner, near their outer edge, and what lies behind.
    const auto one = brightness(image, position(0.75, along - 0.5)),
               other = brightness(image, position(0.75, along + 0.5)),
               behind_one = brightness(image, position(1.3, along - 0.5)),
               behind_other = brightness(image, position(1.3, along + 0.5));
    if (!one || !other || !behind_one || !behind_other) continue;
    const double contrast = std::abs(*one - *other), bright = std::max(*one, *other);
    constexpr double kContrastMin = 30;
    if (contrast < kContrastMin) {
      ++contradicted;
      continue;
    }
    const double margin = bright - 0.4 * contrast;
    if (*behind_one > margin && *behind_other > margin)
      ++shown;
    else
      ++contradicted;
  }
  constexpr int kShownMin = 3;
  return shown >= kShownMin && shown > 2 * contradicted;
}

// Are there squares, dark and bright in turn, behind those which this board would end with? Then a
// larger board is seen.
bool goes_on_beyond(const BoardGrid& grid, const GrayImage& image, bool side_of_i, int at,
                    int outward) {
  const auto difference = [&](double across, int along) -> std::optional<double> {
    const auto seen = [&](double beside) {
      return brightness(image, side_of_i
                                   ? position_of(grid, at + outward * across, along + beside)
                                   : position_of(grid, along + beside, at + outward * across));
    };
    const auto one = seen(-0.5), other = seen(0.5);
    if (!one || !other) return std::nullopt;
    return *other - *one;
  };
  int shown = 0, corners = 0;
  for (const auto& [place, node] : grid.nodes) {
    if ((side_of_i ? place.first : place.second) != at) continue;
    const int along = side_of_i ? place.second : place.first;
    const auto last = difference(0.5, along), behind = difference(1.5, along);
    constexpr double kContrastMin = 30;
    if (!last || !behind || std::abs(*last) < kContrastMin) continue;
    ++corners;
    if (*last * *behind < 0 && std::abs(*behind) > 0.5 * std::abs(*last)) ++shown;
  }
  constexpr int kShownMin = 3;
  return shown >= kShownMin && 2 * shown > corners;
}

Outline outline_of(const BoardGrid& grid, const GrayImage& image) {
  Outline outline;
  const auto first = grid.nodes.begin()->first;
  outline.low_i = outline.high_i = first.first;
  outline.low_j = outline.high_j = first.second;
  for (const auto& [place, node] : grid.nodes) {
    outline.low_i = std::min(outline.low_i, place.first);
    outline.high_i = std::max(outline.high_i, place.first);
    outline.low_j = std::min(outline.low_j, place.second);
    outline.high_j = std::max(outline.high_j, place.second);
  }
  outline.border = {is_border(grid, image, true, outline.low_i, -1),
                    is_border(grid, image, true, outline.high_i, 1),
                    is_border(grid, image, false, outline.low_j, -1),
                    is_border(grid, image, false, outline.high_j, 1)};
  outline.goes_on = {goes_on_beyond(grid, image, true, outline.low_i, -1),
                     goes_on_beyond(grid, image, true, outline.high_i, 1),
                     goes_on_beyond(grid, image, false, outline.low_j, -1),
                     goes_on_beyond(grid, image, false, outline.high_j, 1)};
  return outline;
}

bool is_possible(const Placement& placement, const Outline& outline, const BoardGrid& grid,
                 const Board& board) {
  const auto low = on_board(placement, {outline.low_i, outline.low_j}),
             high = on_board(placement, {outline.high_i, outline.high_j});
  const int column[2] = {std::min(low.first, high.first), std::max(low.first, high.first)};
  const int row[2] = {std::min(low.second, high.second), std::max(low.second, high.second)};
  if (column[0] < 0 || column[1] >= board.columns || row[0] < 0 || row[1] >= board.rows)
    return false;
  // Each border that was seen must be one of the board's, and none where the pattern goes on.
  const std::array<std::pair<int, int>, 4> beyond = {{{outline.low_i - 1, outline.low_j},
                                                      {outline.high_i + 1, outline.low_j},
                                                      {outline.low_i, outline.low_j - 1},
                                                      {outline.low_i, outline.high_j + 1}}};
  for (std::size_t side = 0; side < 4; ++side) {
    const auto [c, r] = on_board(placement, beyond[side]);
    const bool inside = c >= 0 && c < board.columns && r >= 0 && r < board.rows;
    if (inside ? outline.border[side] : outline.goes_on[side]) return false;
  }
  if ((board.rows + board.columns) % 2 == 0) return true;  // the colours tell nothing
  // Corner 0's square away from the board's middle, its (-, -), is dark: so at even row + column
  // the squares along (+, +) are dark. A quarter turn exchanges the two diagonals.
  const auto [c, r] = on_board(placement, {0, 0});
  const int bright_at_origin = grid.bright_at_even * (placement.turn % 2 == 0 ? 1 : -1);
  return bright_at_origin == ((c + r) % 2 == 0 ? -1 : 1);
}

std::vector<Placement> possible_placements(const Outline& outline, const BoardGrid& grid,
                                           const Board& board) {
  std::vector<Placement> possible;
  const int reach =
      2 * std::max({board.rows, board.columns, std::abs(outline.low_i), std::abs(outline.high_i),
                    std::abs(outline.low_j), std::abs(outline.high_j)});
  for (int turn = 0; turn < 4; ++turn)
    for (int column = -reach; column <= reach; ++column)
      for (int row = -reach; row <= reach; ++row) {
        const Placement placement{turn, column, row};
        if (is_possible(placement, outline, grid, board)) possible.push_back(placement);
      }
  return possible;
}

std::vector<Corner> corners_at(const Placement& placement, const BoardGrid& grid,
                               const Board& board) {
  std::vector<Corner> corners;
  for (const auto& [place, node] : grid.nodes) {
    const auto [c, r] = on_board(placement, place);
    corners.push_back({r * board.columns + c, node.pixel});
  }
  std::sort(corners.begin(), corners.end(),
            [](const Corner& a, const Corner& b) { return a.id < b.id; });
  return corners;
}

// Two places that are half a turn apart on a board which looks the same then.
bool are_half_a_turn_apart(const Placement& a, const Placement& b, const Board& board) {
  if ((board.rows + board.columns) % 2 != 0 || (a.turn + 2) % 4 != b.turn) return false;
  const auto [ca, ra] = on_board(a, {0, 0});
  const auto [cb, rb] = on_board(b, {0, 0});
  return ca == board.columns - 1 - cb && ra == board.rows - 1 - rb;
}

}  // namespace

DetectedBoard place_grid(const BoardGrid& grid, const Board& board, const GrayImage& image) {
  DetectedBoard result;
  const Outline outline = outline_of(grid, image);
  std::vector<Placement> possible = possible_placements(outline, grid, board);
  if (possible.empty()) return result;  // no place: the pattern is not this board
  Placement chosen = possible.front();
  if (possible.size() == 2 && are_half_a_turn_apart(possible[0], possible[1], board)) {
    // Both are right; the one whose corner 0 is nearer to the image's top left is taken.
    const auto nearness = [&](const Placement& placement) {
      double sum = 0;
      for (const Corner& corner : corners_at(placement, grid, board))
        sum += (2.0 * corner.id - board.corner_count() + 1) * corner.pixel.sum();
      return sum;
    };
    if (nearness(possible[1]) > nearness(possible[0])) chosen = possible[1];
  } else if (possible.size() > 1) {
    result.placed = false;
    const auto borders = std::count(outline.border.begin(), outline.border.end(), true);
    result.why_not_placed = fmt::format(
        "{} corners of a part of the board were found, but {} of its border, so that they may be "
        "at {} places on it; another camera's view of the same pose or a click must tell",
        grid.nodes.size(), borders == 0 ? "none" : "too little", possible.size());
  }
  result.corners = corners_at(chosen, grid, board);
  result.whole = result.placed && static_cast<int>(result.corners.size()) == board.corner_count();
  return result;
}

}  // namespace wagonsight
