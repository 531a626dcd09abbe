// Finds the chessboard in the images of every sensor.
#include <fmt/format.h>

#include <unistd.h>
#include <algorithm>
#include <filesystem>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "calibrate/board_file.h"
#include "calibrate/observations.h"
#include "commands.h"
#include "linux/files.h"

namespace wagonsight {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> sorted_entries(const fs::path& folder, bool folders) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.is_directory() == folders) entries.push_back(entry.path());
  std::sort(entries.begin(), entries.end());
  return entries;
}

bool is_image(const fs::path& path) {
  static const std::set<std::string> kEndings = {".png", ".jpg", ".jpeg", ".pgm",
                                                 ".bmp", ".tif", ".tiff"};
  std::string ending = path.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return kEndings.contains(ending);
}

// The corners of a whole board in row order, or why there are none.
Result<std::vector<Corner>> detect_board(const cv::Mat& gray, const Board& board) {
  const cv::Size size(board.columns, board.rows);
  std::vector<cv::Point2f> found;
  const int flags = cv::CALIB_CB_EXHAUSTIVE | cv::CALIB_CB_ACCURACY | cv::CALIB_CB_NORMALIZE_IMAGE;
  if (!cv::findChessboardCornersSB(gray, size, found, flags)) {
    // The older detector finds boards at flatter angles; its corners are refined at the saddle.
    if (!cv::findChessboardCorners(gray, size, found,
                                   cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE))
      return fail("no whole board was found; click its corners");
    double nearest = 1e9;
    for (std::size_t i = 1; i < found.size(); ++i)
      if (i % static_cast<std::size_t>(board.columns) != 0)
        nearest = std::min(nearest, cv::norm(found[i] - found[i - 1]));
    const int half = std::clamp(static_cast<int>(nearest / 3), 2, 8);
    cv::cornerSubPix(gray, found, {half, half}, {-1, -1},
                     {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 60, 1e-3});
  }
  std::vector<Corner> corners;
  for (std::size_t i = 0; i < found.size(); ++i)
    corners.push_back({static_cast<int>(i), {found[i].x, found[i].y}});
  return corners;
}

// The board looks the same turned by 180 degrees when rows and columns differ in parity by one or
// not at all; corner 0 is then taken as the one nearer to the image's top left, for every view.
void settle_orientation(std::vector<Corner>& corners, const Board& board) {
  const Eigen::Vector2d first = corners.front().pixel, last = corners.back().pixel;
  if (first.sum() <= last.sum()) return;
  for (Corner& corner : corners) corner.id = board.corner_count() - 1 - corner.id;
}

}  // namespace

Result<void> run_detect(const DetectArguments& arguments) {
  const auto text = read_file(arguments.board, kFileBytesMax);
  if (!text) return fail(text.error().message);
  const auto board = parse_board_file(*text, arguments.board);
  if (!board) return fail(board.error().message);
  const auto folders = sorted_entries(arguments.images, true);
  if (folders.empty())
    return fail(fmt::format(
        "{}: it holds no folder; put the images of each sensor into a folder of the sensor's name",
        arguments.images));
  Observations observations;
  observations.board = *board;
  std::size_t tried = 0, done = 0;
  std::vector<fs::path> files;
  for (const fs::path& folder : folders)
    for (const fs::path& file : sorted_entries(folder, false))
      if (is_image(file)) files.push_back(file);
  const bool progress = isatty(STDERR_FILENO) == 1;
  for (const fs::path& file : files) {
    const std::string sensor = file.parent_path().filename().string();
    const std::string name = sensor + "/" + file.filename().string();
    ++tried;
    if (progress) fmt::print(stderr, "\r{} of {} images, {} boards", tried, files.size(), done);
    const cv::Mat gray = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
    if (gray.empty()) {
      fmt::print("{}: rejected: this is not an image that can be read\n", name);
      continue;
    }
    auto corners = detect_board(gray, *board);
    if (!corners) {
      fmt::print("{}: rejected: {}\n", name, corners.error().message);
      continue;
    }
    settle_orientation(*corners, *board);
    observations.views.push_back({sensor, name, file.stem().string(), std::move(*corners)});
    ++done;
  }
  if (progress) fmt::print(stderr, "\n");
  fmt::print("{} of {} images show a whole board\n", done, tried);
  if (observations.views.empty())
    return fail(fmt::format("{}: no image shows the {} x {} board", arguments.images, board->rows,
                            board->columns));
  return write_file_durably(arguments.out, bytes_of(format_observations(observations)));
}

}  // namespace wagonsight
