// Finds the chessboard in the images of every sensor.
#include <fmt/format.h>

#include <unistd.h>
#include <map>
#include <opencv2/imgcodecs.hpp>

#include "calibrate/board_file.h"
#include "calibrate/detect_board.h"
#include "calibrate/observations.h"
#include "commands.h"
#include "image_folder.h"
#include "linux/files.h"

namespace wagonsight {
namespace {

// What detect says of each image that gave no view, and of what it took.
class Teller {
 public:
  explicit Teller(std::size_t files) : files_(files), progress_(isatty(STDERR_FILENO) == 1) {}
  ~Teller() {
    if (progress_) fmt::print(stderr, "\n");
  }
  Teller(const Teller&) = delete;
  Teller& operator=(const Teller&) = delete;
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
void detect_file(const ListedImage& image, const Board& board,
                 std::map<std::string, cv::Size>& sizes, Observations& observations,
                 Teller& teller) {
  const std::string& name = image.name;
  teller.next();
  const cv::Mat gray = cv::imread(image.path, cv::IMREAD_GRAYSCALE);
  if (gray.empty()) return Teller::reject(name, "this is not an image that can be read");
  const auto [size, is_first] = sizes.try_emplace(image.sensor, gray.size());
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
      {image.sensor, name, image.stem, std::move(detected->corners), detected->placed});
}

}  // namespace

Result<void> run_detect(const DetectArguments& arguments) {
  const auto text = read_file(arguments.board, kFileBytesMax);
  if (!text) return fail(text.error().message);
  const auto board = parse_board_file(*text, arguments.board);
  if (!board) return fail(board.error().message);
  const auto images = list_images(arguments.images);
  if (!images) return fail(images.error().message);
  Observations observations;
  observations.board = *board;
  {
    Teller teller(images->size());
    std::map<std::string, cv::Size> sizes;
    for (const ListedImage& image : *images)
      detect_file(image, *board, sizes, observations, teller);
    fmt::print("{} of {} images show the board, {} the whole of it, {} a part without its place\n",
               teller.found, teller.tried(), teller.whole, teller.unplaced);
  }
  if (observations.views.empty())
    return fail(fmt::format("{}: no image shows the {} x {} board", arguments.images, board->rows,
                            board->columns));
  return write_file_durably(arguments.out, bytes_of(format_observations(observations)));
}

}  // namespace wagonsight
