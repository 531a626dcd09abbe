// Start values of an imager's intrinsics by Zhang's method, and which corners of a view to trust.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "calibrate/problem.h"

namespace wagonsight::calibration {

// Corners of a view that agree with one homography; wrong IDs mostly do not.
std::vector<Corner> consistent_corners(const Board& board, const View& view) {
  std::vector<cv::Point2d> on_board, in_image;
  for (const Corner& corner : view.corners) {
    const Eigen::Vector3d p = board.point(corner.id);
    on_board.emplace_back(p.x(), p.y());
    in_image.emplace_back(corner.pixel.x(), corner.pixel.y());
  }
  if (view.corners.size() < 4) return {};  // fewer fix no homography
  constexpr double kDistortedPx = 6;       // a homography knows no distortion
  std::vector<unsigned char> inlier;
  cv::setRNGSeed(0);
  const cv::Mat H = cv::findHomography(on_board, in_image, cv::RANSAC, kDistortedPx, inlier);
  std::vector<Corner> kept;
  if (H.empty()) return kept;
  for (std::size_t i = 0; i < view.corners.size(); ++i)
    if (inlier[i]) kept.push_back(view.corners[i]);
  return kept;
}

// Corners on one line fix no pose.
bool spans_the_plane(const Board& board, const std::vector<Corner>& corners) {
  if (corners.size() < 4) return false;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Corner& c : corners) mean += board.point(c.id).head<2>();
  mean /= static_cast<double>(corners.size());
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  for (const Corner& c : corners) {
    const Eigen::Vector2d d = board.point(c.id).head<2>() - mean;
    scatter += d * d.transpose();
  }
  return scatter.determinant() > 1e-4 * scatter.trace() * scatter.trace();
}

namespace {

// How much a view tells of a lens: an estimate of its homography's perspective, which a board that
// is seen straight on has none of, times its size.
double tilt_of(const Board& board, const std::vector<Corner>& corners) {
  std::vector<cv::Point2d> on_board, in_image;
  double size = 0;
  for (const Corner& corner : corners) {
    const Eigen::Vector3d p = board.point(corner.id) / board.square_m;
    on_board.emplace_back(p.x(), p.y());
    in_image.emplace_back(corner.pixel.x(), corner.pixel.y());
    size = std::max(size, (corner.pixel - corners.front().pixel).norm());
  }
  const cv::Mat H = cv::findHomography(on_board, in_image, 0);
  if (H.empty()) return 0;
  const double perspective = std::hypot(H.at<double>(2, 0), H.at<double>(2, 1));
  return perspective * (board.rows + board.columns) * size;
}

// The views that tell most of an imager's lens. A start value needs no more, and Zhang's method as
// OpenCV has it takes seconds for forty.
std::vector<std::vector<Corner>> telling_views(const Problem& problem, int imager) {
  constexpr std::size_t kViews = 10;
  constexpr std::size_t kCorners = 800;  // of small boards, or parts of them, more views are taken
  constexpr std::size_t kCornersMin = 8;
  std::vector<std::pair<double, std::vector<Corner>>> views;
  for (std::size_t v = 0; v < problem.views.size(); ++v) {
    if (problem.view_imager[v] != imager) continue;
    auto corners = consistent_corners(problem.board, problem.views[v]);
    if (corners.size() < kCornersMin || !spans_the_plane(problem.board, corners)) continue;
    const double tilt = tilt_of(problem.board, corners);
    views.emplace_back(tilt, std::move(corners));
  }
  std::stable_sort(views.begin(), views.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<std::vector<Corner>> result;
  std::size_t corners = 0;
  for (auto& view : views) {
    if (result.size() >= kViews && corners >= kCorners) break;
    corners += view.second.size();
    result.push_back(std::move(view.second));
  }
  return result;
}

}  // namespace

Result<void> start_camera(Problem& problem, int imager) {
  const SensorSpec& spec = problem.spec(imager);
  Camera& camera = problem.cameras[static_cast<std::size_t>(imager)];
  const std::string& name = problem.imagers[static_cast<std::size_t>(imager)].name;
  if (spec.start) {
    camera = *spec.start;
    return {};
  }
  std::vector<std::vector<cv::Point3f>> objects;
  std::vector<std::vector<cv::Point2f>> images;
  for (const std::vector<Corner>& corners : telling_views(problem, imager)) {
    auto& object = objects.emplace_back();
    auto& image = images.emplace_back();
    for (const Corner& corner : corners) {
      const Eigen::Vector3f p = problem.board.point(corner.id).cast<float>();
      object.emplace_back(p.x(), p.y(), 0.0F);
      image.emplace_back(static_cast<float>(corner.pixel.x()),
                         static_cast<float>(corner.pixel.y()));
    }
  }
  if (objects.size() < 3)
    return fail(
        fmt::format("{}: its intrinsics are not given and {} usable views cannot tell them; "
                    "state fx, fy, cx, cy or take at least three tilted views",
                    name, objects.size()));
  cv::Mat K = cv::initCameraMatrix2D(objects, images, {spec.width, spec.height});
  cv::Mat D = cv::Mat::zeros(1, 5, CV_64F);
  std::vector<cv::Mat> rotations, positions;
  cv::calibrateCamera(objects, images, {spec.width, spec.height}, K, D, rotations, positions,
                      cv::CALIB_USE_INTRINSIC_GUESS | cv::CALIB_FIX_K3);
  camera.width = spec.width;
  camera.height = spec.height;
  camera.fx = K.at<double>(0, 0);
  camera.fy = K.at<double>(1, 1);
  camera.cx = K.at<double>(0, 2);
  camera.cy = K.at<double>(1, 2);
  for (int i = 0; i < 5; ++i) camera.distortion[static_cast<std::size_t>(i)] = D.at<double>(i);
  return {};
}

}  // namespace wagonsight::calibration
