// wagonsight-calibrate-peers FOLDER: OpenCV's own chessboard images (Debian's opencv-doc, unpacked:
// left01.jpg and right01.jpg to 14) through cv::stereoCalibrate and through wagonsight, the same
// corners to both; prints one table.
#include <fmt/format.h>

#include <array>
#include <filesystem>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>

#include "calibrate/detect_board.h"
#include "calibrate/solve.h"

using namespace wagonsight;

namespace {

constexpr int kWidth = 640, kHeight = 480;
const Board kBoard{6, 9, 0.025};

struct Corners {
  Observations observations;
  // By pair of images, whole boards of both sides.
  std::vector<std::vector<cv::Point3f>> objects;
  std::array<std::vector<std::vector<cv::Point2f>>, 2> pixels;
};

Corners detect(const std::string& folder) {
  Corners corners;
  corners.observations.board = kBoard;
  for (int n = 1; n <= 14; ++n) {
    std::array<std::vector<Corner>, 2> found;
    for (const int side : {0, 1}) {
      const std::string name = fmt::format("{}{:02}.jpg", side == 0 ? "left" : "right", n);
      const cv::Mat image = cv::imread(folder + "/" + name, cv::IMREAD_GRAYSCALE);
      if (image.empty()) continue;
      auto detected = detect_board({image.data, image.cols, image.rows}, kBoard);
      if (!detected || !detected->whole) continue;
      found[static_cast<std::size_t>(side)] = detected->corners;
    }
    if (found[0].empty() || found[1].empty()) continue;
    auto& object = corners.objects.emplace_back();
    for (int id = 0; id < kBoard.corner_count(); ++id) {
      const Eigen::Vector3f p = kBoard.point(id).cast<float>();
      object.emplace_back(p.x(), p.y(), 0.0F);
    }
    for (const std::size_t side : {0U, 1U}) {
      auto& pixels = corners.pixels[side].emplace_back();
      for (const Corner& corner : found[side])
        pixels.emplace_back(static_cast<float>(corner.pixel.x()),
                            static_cast<float>(corner.pixel.y()));
      corners.observations.views.push_back({side == 0 ? "pair.left" : "pair.right",
                                            fmt::format("{:02}", n), fmt::format("{:02}", n),
                                            found[side]});
    }
  }
  return corners;
}

void print_row(const char* who, double rms_left, double rms_right, double baseline_m, double fx) {
  const double both = std::sqrt((rms_left * rms_left + rms_right * rms_right) / 2);
  fmt::print("{:<28} {:>9.4f} {:>9.4f} {:>9.4f} {:>12.2f} {:>9.2f}\n", who, rms_left, rms_right,
             both, baseline_m * 1e3, fx);
}

void opencv(const Corners& corners) {
  std::array<cv::Mat, 2> K, D;
  const cv::Size size(kWidth, kHeight);
  for (const std::size_t side : {0U, 1U}) {
    std::vector<cv::Mat> turns, places;
    cv::calibrateCamera(corners.objects, corners.pixels[side], size, K[side], D[side], turns,
                        places);
  }
  cv::Mat R, T, E, F, by_view;
  cv::stereoCalibrate(corners.objects, corners.pixels[0], corners.pixels[1], K[0], D[0], K[1], D[1],
                      size, R, T, E, F, by_view, cv::CALIB_USE_INTRINSIC_GUESS,
                      {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 200, 1e-12});
  double squares[2] = {0, 0};
  for (int v = 0; v < by_view.rows; ++v)
    for (int side = 0; side < 2; ++side)
      squares[side] += by_view.at<double>(v, side) * by_view.at<double>(v, side) / by_view.rows;
  print_row("cv::stereoCalibrate", std::sqrt(squares[0]), std::sqrt(squares[1]), cv::norm(T),
            K[0].at<double>(0, 0));
}

void ours(const Corners& corners, bool keep_all) {
  SensorSpec pair;
  pair.name = "pair";
  pair.kind = SensorKind::kStereo;
  pair.width = kWidth;
  pair.height = kHeight;
  SolveOptions options;
  if (keep_all) options.reject_sigmas = 0;
  const auto solution = solve(corners.observations, {pair}, options);
  if (!solution) {
    fmt::print("{}\n", solution.error().message);
    return;
  }
  print_row(keep_all ? "wagonsight, every corner" : "wagonsight", solution->imagers[0].rms_px,
            solution->imagers[1].rms_px, solution->pairs[0].baseline_m,
            solution->imagers[0].camera.fx);
  fmt::print("  held out {:.4f} and {:.4f} px; baseline +- {:.2f} mm; {} of {} corners rejected\n",
             solution->imagers[0].held_out_rms_px, solution->imagers[1].held_out_rms_px,
             solution->pairs[0].baseline_sigma_m * 1e3,
             solution->imagers[0].rejected + solution->imagers[1].rejected,
             2 * corners.objects.size() * static_cast<std::size_t>(kBoard.corner_count()));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    fmt::print(stderr,
               "usage: wagonsight-calibrate-peers FOLDER with left01.jpg ... right14.jpg\n");
    return 2;
  }
  const Corners corners = detect(argv[1]);
  if (corners.objects.size() < 3) {
    fmt::print(stderr, "{}: {} whole pairs of left and right images; unpack opencv-doc there\n",
               argv[1], corners.objects.size());
    return 1;
  }
  fmt::print("{} whole pairs\n{:<28} {:>9} {:>9} {:>9} {:>12} {:>9}\n", corners.objects.size(),
             "RMS of residual lengths, px", "left", "right", "both", "baseline mm", "fx left");
  opencv(corners);
  ours(corners, true);
  ours(corners, false);
  return 0;
}
