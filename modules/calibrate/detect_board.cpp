#include "calibrate/detect_board.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
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

// A whole board in OpenCV's order, as a grid: columns along i, rows along j, clockwise.
BoardGrid to_grid(const std::vector<cv::Point2f>& found, const Board& board,
                  const std::vector<SaddlePoint>& saddles) {
  BoardGrid grid;
  const auto at = [&](int column, int row) {
    const cv::Point2f& p = found[static_cast<std::size_t>(row * board.columns + column)];
    return Eigen::Vector2d(p.x, p.y);
  };
  const Eigen::Vector2d along = at(1, 0) - at(0, 0), down = at(0, 1) - at(0, 0);
  const bool mirrored = along.x() * down.y() - along.y() * down.x() < 0;
  for (int row = 0; row < board.rows; ++row)
    for (int column = 0; column < board.columns; ++column)
      grid.nodes[{mirrored ? board.columns - 1 - column : column, row}] = {at(column, row), 0};
  // The colouring by vote of the saddles that coincide with nodes.
  int votes = 0;
  for (const auto& [place, node] : grid.nodes) {
    const auto saddle = std::min_element(
        saddles.begin(), saddles.end(), [&](const SaddlePoint& a, const SaddlePoint& b) {
          return (a.pixel - node.pixel).squaredNorm() < (b.pixel - node.pixel).squaredNorm();
        });
    if (saddle == saddles.end() || (saddle->pixel - node.pixel).norm() > 2) continue;
    const Eigen::Vector2d diagonal = (position_of(grid, place.first + 0.5, place.second + 0.5) -
                                      position_of(grid, place.first - 0.5, place.second - 0.5))
                                         .normalized();
    const Eigen::Vector2d bright(std::cos(saddle->bright_angle), std::sin(saddle->bright_angle));
    const bool even = (place.first + place.second) % 2 == 0;
    votes += (std::abs(bright.dot(diagonal)) > 0.7071) == even ? 1 : -1;
  }
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

// Corners that hang together but do not lie where their neighbours' homography has them were taken
// from something before the board.
void drop_misfits(BoardGrid& grid) {
  for (auto it = grid.nodes.begin(); it != grid.nodes.end();) {
    const auto place = it->first;
    BoardGrid others;
    for (const auto& [at, node] : grid.nodes)
      if (at != place && std::abs(at.first - place.first) <= 3 &&
          std::abs(at.second - place.second) <= 3)
        others.nodes.emplace(at, node);
    const Eigen::Vector2d expected =
        others.nodes.size() < 6 ? it->second.pixel : position_of(others, place.first, place.second);
    constexpr double kMisfit_px = 2.5;
    if (!expected.allFinite() || (expected - it->second.pixel).norm() > kMisfit_px)
      it = grid.nodes.erase(it);
    else
      ++it;
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
  } else {
    grid = find_grid(saddles, std::max(board.rows, board.columns));
    if (!grid.nodes.empty()) refine(grid, gray);
    if (!grid.nodes.empty()) drop_misfits(grid);
  }
  if (grid.nodes.size() < kCornersMin)
    return fail(
        fmt::format("no board was found: the largest part that hangs together has {} of "
                    "{} corners; click them",
                    grid.nodes.size(), board.corner_count()));
  DetectedBoard result = place_grid(grid, board, image);
  if (result.corners.empty())
    return fail(
        fmt::format("a pattern of {} x {} corners was found, which is no part of the {} x "
                    "{} board",
                    grid.extent_i(), grid.extent_j(), board.rows, board.columns));
  return result;
}

}  // namespace wagonsight
