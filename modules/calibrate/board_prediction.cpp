#include "calibrate/board_prediction.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

namespace wagonsight {
namespace {

constexpr std::size_t kRadialCornersMin = 12;

// Homography of the board's plane (in squares) to the image, then one radial term about the
// image's centre: p = c + (1 + k r^2) (h - c), r in units of the image's width.
struct PlaneMap {
  Eigen::Matrix3d H = Eigen::Matrix3d::Identity();
  double k = 0;
  Eigen::Vector2d centre;
  double unit = 1;

  Eigen::Vector2d operator()(const Board& board, int id) const {
    const Eigen::Vector3d h = H * Eigen::Vector3d(id % board.columns, id / board.columns, 1.0);
    const Eigen::Vector2d from_centre = (h.head<2>() / h.z() - centre) / unit;
    return centre + unit * (1 + k * from_centre.squaredNorm()) * from_centre;
  }
  double& parameter(int i) { return i < 8 ? H(i / 3, i % 3) : k; }
};

// A few steps of Gauss-Newton on all nine parameters; differences will do, there are few corners.
void refine(const Board& board, const std::vector<Corner>& known, PlaneMap& map) {
  for (int iteration = 0; iteration < 15; ++iteration) {
    Eigen::Matrix<double, 9, 9> N = Eigen::Matrix<double, 9, 9>::Zero();
    Eigen::Matrix<double, 9, 1> g = Eigen::Matrix<double, 9, 1>::Zero();
    for (const Corner& corner : known) {
      const Eigen::Vector2d at = map(board, corner.id);
      Eigen::Matrix<double, 2, 9> J;
      for (int i = 0; i < 9; ++i) {
        PlaneMap moved = map;
        const double step = 1e-6 * std::max(1e-2, std::abs(moved.parameter(i)));
        moved.parameter(i) += step;
        J.col(i) = (moved(board, corner.id) - at) / step;
      }
      N += J.transpose() * J;
      g += J.transpose() * (corner.pixel - at);
    }
    N.diagonal() *= 1 + 1e-9;
    const Eigen::Matrix<double, 9, 1> step = N.ldlt().solve(g);
    if (!step.allFinite()) return;
    for (int i = 0; i < 9; ++i) map.parameter(i) += step[i];
  }
}

std::optional<PlaneMap> fit_plane(const Board& board, const std::vector<Corner>& known, int width,
                                  int height) {
  std::vector<cv::Point2d> from, to;
  for (const Corner& corner : known) {
    from.emplace_back(corner.id % board.columns, corner.id / board.columns);
    to.emplace_back(corner.pixel.x(), corner.pixel.y());
  }
  const cv::Mat H = cv::findHomography(from, to, 0);
  if (H.empty()) return std::nullopt;
  PlaneMap map;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) map.H(r, c) = H.at<double>(r, c) / H.at<double>(2, 2);
  map.centre = {(width - 1) / 2.0, (height - 1) / 2.0};
  map.unit = width;
  if (known.size() >= kRadialCornersMin) {
    PlaneMap bent = map;
    refine(board, known, bent);
    if (bent.H.allFinite() && std::abs(bent.k) < 1) map = bent;
  }
  return map;
}

// Four corners of which no three are on one line fix a homography. That is so exactly when the
// linear equations for the board's map onto itself leave one solution, its scale.
bool spans_a_plane(const Board& board, const std::vector<Corner>& known) {
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(2 * static_cast<Eigen::Index>(known.size()), 9);
  for (std::size_t i = 0; i < known.size(); ++i) {
    const double x = static_cast<double>(known[i].id % board.columns) / board.columns;
    const double y = static_cast<double>(known[i].id / board.columns) / board.rows;
    const auto row = 2 * static_cast<Eigen::Index>(i);
    A.row(row) << x, y, 1, 0, 0, 0, -x * x, -x * y, -x;
    A.row(row + 1) << 0, 0, 0, x, y, 1, -y * x, -y * y, -y;
  }
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> factor(A);
  factor.setThreshold(1e-9);
  return factor.rank() == 8;
}

bool predict_by_pose(const Board& board, const std::vector<Corner>& known, const Camera& camera,
                     std::vector<Corner>& predicted) {
  std::vector<cv::Point3d> on_board;
  std::vector<cv::Point2d> in_image;
  for (const Corner& corner : known) {
    const Eigen::Vector3d p = board.point(corner.id);
    on_board.emplace_back(p.x(), p.y(), p.z());
    in_image.emplace_back(corner.pixel.x(), corner.pixel.y());
  }
  const cv::Mat K =
      (cv::Mat_<double>(3, 3) << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  const std::vector<double> distortion(camera.distortion.begin(), camera.distortion.end());
  cv::Mat turn, position;
  if (!cv::solvePnP(on_board, in_image, K, distortion, turn, position, false, cv::SOLVEPNP_IPPE))
    return false;
  cv::solvePnPRefineLM(on_board, in_image, K, distortion, turn, position);
  std::vector<cv::Point3d> all;
  for (int id = 0; id < board.corner_count(); ++id) {
    const Eigen::Vector3d p = board.point(id);
    all.emplace_back(p.x(), p.y(), p.z());
  }
  std::vector<cv::Point2d> projected;
  cv::projectPoints(all, turn, position, K, distortion, projected);
  for (std::size_t i = 0; i < projected.size(); ++i) {
    if (!std::isfinite(projected[i].x) || !std::isfinite(projected[i].y)) return false;
    predicted.push_back({static_cast<int>(i), {projected[i].x, projected[i].y}});
  }
  return true;
}

}  // namespace

std::optional<BoardPrediction> predict_board(const Board& board, const std::vector<Corner>& known,
                                             int width, int height,
                                             const std::optional<Camera>& camera) {
  if (known.size() < 4 || !spans_a_plane(board, known)) return std::nullopt;
  const auto map = fit_plane(board, known, width, height);
  if (!map) return std::nullopt;
  BoardPrediction prediction;
  const Eigen::Vector3d middle =
      map->H * Eigen::Vector3d((board.columns - 1) / 2.0, (board.rows - 1) / 2.0, 1.0);
  // The sign of the map's Jacobian determinant is det(H) over the cube of the denominator.
  prediction.mirrored = map->H.determinant() * middle.z() < 0;
  const bool by_pose =
      camera && !prediction.mirrored && predict_by_pose(board, known, *camera, prediction.corners);
  if (!by_pose) {
    prediction.corners.clear();
    for (int id = 0; id < board.corner_count(); ++id)
      prediction.corners.push_back({id, (*map)(board, id)});
  }
  double sum = 0;
  for (const Corner& corner : known) {
    const double length =
        (corner.pixel - prediction.corners[static_cast<std::size_t>(corner.id)].pixel).norm();
    sum += length * length;
    prediction.misfits.push_back({corner.id, length});
  }
  prediction.rms_px = std::sqrt(sum / static_cast<double>(known.size()));
  std::sort(prediction.misfits.begin(), prediction.misfits.end(),
            [](const auto& a, const auto& b) { return a.length_px > b.length_px; });
  return prediction;
}

double spacing_at(const Board& board, const BoardPrediction& prediction, int id) {
  const int row = id / board.columns, column = id % board.columns;
  double nearest = 1e9;
  for (const auto& [dr, dc] : {std::array{0, 1}, {0, -1}, {1, 0}, {-1, 0}}) {
    if (row + dr < 0 || row + dr >= board.rows || column + dc < 0 || column + dc >= board.columns)
      continue;
    const int other = (row + dr) * board.columns + column + dc;
    nearest = std::min(nearest, (prediction.corners[static_cast<std::size_t>(id)].pixel -
                                 prediction.corners[static_cast<std::size_t>(other)].pixel)
                                    .norm());
  }
  return nearest;
}

}  // namespace wagonsight
