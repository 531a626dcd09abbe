#include "calibrate/detect_board.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "calibrate/board_grid.h"
#include "calibrate/board_placement.h"
#include "calibrate/saddle_points.h"

namespace wagonsight {
namespace {

cv::Mat as_mat(const GrayImage& image) {
  return {image.height, image.width, CV_8U, const_cast<std::uint8_t*>(image.pixels)};
}

// A whole board in OpenCV's order, as a grid: columns along i, rows along j, clockwise. Empty when
// the colours do not alternate from corner to corner: in a larger pattern, corners across the
// diagonals were taken.
BoardGrid to_grid(const std::vector<cv::Point2f>& found, const Board& board,
                  const std::vector<SaddlePoint>& saddles) {
  BoardGrid grid;
  const auto at = [&](int column, int row) {
    const int id = row * board.columns + column;
    const cv::Point2f& p = found[static_cast<std::size_t>(id)];
    return Eigen::Vector2d(p.x, p.y);
  };
  const Eigen::Vector2d along = at(1, 0) - at(0, 0), down = at(0, 1) - at(0, 0);
  const bool mirrored = along.x() * down.y() - along.y() * down.x() < 0;
  for (int row = 0; row < board.rows; ++row)
    for (int column = 0; column < board.columns; ++column)
      grid.nodes[{mirrored ? board.columns - 1 - column : column, row}] = {at(column, row), 0};
  // The colouring by vote of the saddles that coincide with nodes.
  int votes = 0, voters = 0;
  for (const auto& [place, node] : grid.nodes) {
    const Eigen::Vector2d& pixel = node.pixel;
    const auto saddle = std::min_element(
        saddles.begin(), saddles.end(), [&](const SaddlePoint& a, const SaddlePoint& b) {
          return (a.pixel - pixel).squaredNorm() < (b.pixel - pixel).squaredNorm();
        });
    if (saddle == saddles.end() || (saddle->pixel - pixel).norm() > 2) continue;
    const Eigen::Vector2d diagonal = (position_of(grid, place.first + 0.5, place.second + 0.5) -
                                      position_of(grid, place.first - 0.5, place.second - 0.5))
                                         .normalized();
    const Eigen::Vector2d bright(std::cos(saddle->bright_angle), std::sin(saddle->bright_angle));
    const bool even = (place.first + place.second) % 2 == 0;
    votes += (std::abs(bright.dot(diagonal)) > 0.7071) == even ? 1 : -1;
    ++voters;
  }
  constexpr double kAgree = 0.8;
  if (std::abs(votes) < kAgree * voters) return {};
  grid.bright_at_even = votes >= 0 ? 1 : -1;
  return grid;
}

// Moves the nodes to the saddles' exact places; nodes that will not stay go.
void refine(BoardGrid& grid, const cv::Mat& gray) {
  for (auto it = grid.nodes.begin(); it != grid.nodes.end();) {
    const auto [i, j] = it->first;
    double nearest = 1e9;
    for (const auto& [di, dj] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}})
      if (const auto beside = grid.nodes.find({i + di, j + dj}); beside != grid.nodes.end())
        nearest = std::min(nearest, (beside->second.pixel - it->second.pixel).norm());
    // A third of a square: the window must not reach the next corner's edges.
    const int half = std::clamp(static_cast<int>(nearest / 3), 2, 8);
    const Eigen::Vector2d before = it->second.pixel;
    std::vector<cv::Point2f> point{
        {static_cast<float>(before.x()), static_cast<float>(before.y())}};
    const bool inside = before.x() > half + 2 && before.y() > half + 2 &&
                        before.x() < gray.cols - half - 3 && before.y() < gray.rows - half - 3;
    if (inside)
      cv::cornerSubPix(gray, point, {half, half}, {-1, -1},
                       {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 60, 1e-3});
    const Eigen::Vector2d after(static_cast<double>(point[0].x), static_cast<double>(point[0].y));
    constexpr double kMoveMax_px = 2.5;
    if (!inside || nearest > 1e8 || (after - before).norm() > kMoveMax_px) {
      it = grid.nodes.erase(it);
      continue;
    }
    it->second.pixel = after;
    ++it;
  }
}

// How far a node lies from where its neighbours' homography has it; 0 where too few tell.
double misfit_of(const BoardGrid& grid, const std::pair<int, int>& place) {
  BoardGrid others;
  for (const auto& [at, node] : grid.nodes)
    if (at != place && std::abs(at.first - place.first) <= 3 &&
        std::abs(at.second - place.second) <= 3)
      others.nodes.emplace(at, node);
  constexpr std::size_t kTelling = 6;
  if (others.nodes.size() < kTelling) return 0;
  const Eigen::Vector2d expected = position_of(others, place.first, place.second);
  if (!expected.allFinite()) return 0;
  return (expected - grid.nodes.at(place).pixel).norm();
}

// Corners that hang together but do not lie where their neighbours' homography has them were taken
// from something before the board, or a bar's edge beside them has moved them. The worst goes
// first, for it spoils what its neighbours expect; what is far is measured by what all others are,
// but `tolerated_px` is not.
void drop_misfits(BoardGrid& grid, double tolerated_px) {
  std::map<std::pair<int, int>, double> misfits;
  for (const auto& [place, node] : grid.nodes) misfits[place] = misfit_of(grid, place);
  while (!misfits.empty()) {
    std::vector<double> sorted;
    sorted.reserve(misfits.size());
    for (const auto& [place, misfit] : misfits) sorted.push_back(misfit);
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    constexpr double kMisfitMax_px = 2.5, kMedians = 5;
    const double limit = std::clamp(kMedians * *middle, tolerated_px, kMisfitMax_px);
    const auto worst =
        std::max_element(misfits.begin(), misfits.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    if (worst->second <= limit) return;
    const auto gone = worst->first;
    grid.nodes.erase(gone);
    misfits.erase(worst);
    for (auto& [place, misfit] : misfits)
      if (std::abs(place.first - gone.first) <= 3 && std::abs(place.second - gone.second) <= 3)
        misfit = misfit_of(grid, place);
  }
}

// A row or column of one corner at the edge of what was found says too little to be the board's
// end: where a board ends decides what its corners are called.
void drop_lone_sides(BoardGrid& grid) {
  for (bool dropped = true; dropped && !grid.nodes.empty();) {
    dropped = false;
    std::map<int, int> by_i, by_j;
    for (const auto& [place, node] : grid.nodes) ++by_i[place.first], ++by_j[place.second];
    const auto is_lone = [&](const std::pair<int, int>& place) {
      const bool end_of_i =
          place.first == by_i.begin()->first || place.first == by_i.rbegin()->first;
      const bool end_of_j =
          place.second == by_j.begin()->first || place.second == by_j.rbegin()->first;
      return (end_of_i && by_i[place.first] == 1) || (end_of_j && by_j[place.second] == 1);
    };
    dropped = std::erase_if(grid.nodes, [&](const auto& item) { return is_lone(item.first); }) > 0;
  }
}

}  // namespace

Result<DetectedBoard> detect_board(const GrayImage& image, const Board& board) {
  if (image.width < 32 || image.height < 32) return fail("the image is too small to show a board");
  const cv::Mat gray = as_mat(image);
  const std::vector<SaddlePoint> saddles = find_saddle_points(image);
  constexpr std::size_t kCornersMin = 8;
  if (saddles.size() < kCornersMin)
    return fail(
        fmt::format("no board was found: {} corner-like places in the whole image (too "
                    "dark, too blurred, or no board)",
                    saddles.size()));
  std::vector<cv::Point2f> found;
  const int flags = cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_ACCURACY | cv::CALIB_CB_NORMALIZE_IMAGE;
  BoardGrid grid;
  if (cv::findChessboardCornersSB(gray, {board.columns, board.rows}, found, flags)) {
    grid = to_grid(found, board, saddles);
    // OpenCV also finds corners that a bar covers, some pixels beside their places.
    drop_misfits(grid, 1.5);
  }
  if (grid.nodes.empty()) {
    grid = find_grid(saddles, std::max(board.rows, board.columns));
    if (!grid.nodes.empty()) refine(grid, gray);
    if (!grid.nodes.empty()) drop_misfits(grid, 0.8);
    drop_lone_sides(grid);
  }
  if (grid.nodes.size() < kCornersMin)
    return fail(
        fmt::format("no board was found: the largest part that hangs together has {} of "
                    "{} corners; click them",
                    grid.nodes.size(), board.corner_count()));
  DetectedBoard result = place_grid(grid, board, image);
  if (result.corners.empty())
    return fail(
        fmt::format("a pattern of {} x {} corners or more was found, which is no part of the {} x "
                    "{} board",
                    grid.extent_i(), grid.extent_j(), board.rows, board.columns));
  return result;
}

}  // namespace wagonsight
