// Finds the chessboard in the images of every sensor.
#include <fmt/format.h>

#include <unistd.h>
#include <algorithm>
#include <filesystem>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <set>

#include "calibrate/board_file.h"
#include "calibrate/detect_board.h"
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

// Depth images of a sensor lie beside its folder, in NAME.depth; solve reads them.
bool is_depth_folder(const fs::path& folder) {
  return folder.extension() == ".depth";
}

// What detect says of each image that gave no view, and of what it took.
class Teller {
 public:
  explicit Teller(std::size_t files) : files_(files), progress_(isatty(STDERR_FILENO) == 1) {}
  ~Teller() {
    if (progress_) fmt::print(stderr, "\n");
  }
  void next() {
    ++tried_;
    if (progress_) fmt::print(stderr, "\r{} of {} images, {} boards", tried_, files_, found);
  }
  static void reject(const std::string& name, std::string_view why) {
    fmt::print("{}: rejected: {}\n", name, why);
  }
  std::size_t found = 0, whole = 0, unplaced = 0;
  std::size_t tried() const { return tried_; }

 private:
  std::size_t files_, tried_ = 0;
  bool progress_;
};

// One image to one view; a rejected one is told.
void detect_file(const fs::path& file, const Board& board, std::map<std::string, cv::Size>& sizes,
                 Observations& observations, Teller& teller) {
  const std::string sensor = file.parent_path().filename().string();
  const std::string name = sensor + "/" + file.filename().string();
  teller.next();
  const cv::Mat gray = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
  if (gray.empty()) return Teller::reject(name, "this is not an image that can be read");
  const auto [size, is_first] = sizes.try_emplace(sensor, gray.size());
  if (!is_first && size->second != gray.size())
    return Teller::reject(
        name, fmt::format("it is {} x {}, but the sensor's first image is {} x {}", gray.cols,
                          gray.rows, size->second.width, size->second.height));
  auto detected = detect_board({gray.data, gray.cols, gray.rows}, board);
  if (!detected) return Teller::reject(name, detected.error().message);
  ++teller.found;
  if (detected->whole) ++teller.whole;
  if (!detected->placed) {
    ++teller.unplaced;
    fmt::print("{}: {}\n", name, detected->why_not_placed);
  } else if (!detected->whole) {
    fmt::print("{}: {} of {} corners\n", name, detected->corners.size(), board.corner_count());
  }
  observations.views.push_back(
      {sensor, name, file.stem().string(), std::move(detected->corners), detected->placed});
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
  std::vector<fs::path> files;
  for (const fs::path& folder : folders)
    for (const fs::path& file : sorted_entries(folder, false))
      if (!is_depth_folder(folder) && is_image(file)) files.push_back(file);
  {
    Teller teller(files.size());
    std::map<std::string, cv::Size> sizes;
    for (const fs::path& file : files) detect_file(file, *board, sizes, observations, teller);
    fmt::print("{} of {} images show the board, {} the whole of it, {} a part without its place\n",
               teller.found, teller.tried(), teller.whole, teller.unplaced);
  }
  if (observations.views.empty())
    return fail(fmt::format("{}: no image shows the {} x {} board", arguments.images, board->rows,
                            board->columns));
  return write_file_durably(arguments.out, bytes_of(format_observations(observations)));
}

}  // namespace wagonsight
