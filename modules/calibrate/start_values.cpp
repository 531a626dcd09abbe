// Start values: a resection for every view, and a walk over the graph of imagers that share board
// poses.
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <string_view>
#include <utility>

#include "calibrate/problem.h"

namespace wagonsight::calibration {
namespace {

// A candidate of a view's pose: a flat board seen small has two that explain it nearly alike.
struct Resection {
  std::vector<Rigid> X_SP;  // best first
  double rms_px = 0;
};

cv::Mat matrix_of(const Camera& camera) {
  return (cv::Mat_<double>(3, 3) << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
}

cv::Mat distortion_of(const Camera& camera) {
  return cv::Mat(1, 5, CV_64F, const_cast<double*>(camera.distortion.data())).clone();
}

Resection resect(const Problem& problem, int imager, const View& view) {
  Resection result;
  const std::vector<Corner> corners = consistent_corners(problem.board, view);
  if (!spans_the_plane(problem.board, corners)) return result;
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> image;
  for (const Corner& corner : corners) {
    const Eigen::Vector3d p = problem.board.point(corner.id);
    object.emplace_back(p.x(), p.y(), 0.0);
    image.emplace_back(corner.pixel.x(), corner.pixel.y());
  }
  const Camera& camera = problem.cameras[static_cast<std::size_t>(imager)];
  std::vector<cv::Mat> rotations, positions;
  std::vector<double> errors;
  cv::solvePnPGeneric(object, image, matrix_of(camera), distortion_of(camera), rotations, positions,
                      false, cv::SOLVEPNP_IPPE, cv::noArray(), cv::noArray(), errors);
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    cv::solvePnPRefineLM(object, image, matrix_of(camera), distortion_of(camera), rotations[i],
                         positions[i]);
    const Eigen::Vector3d r(rotations[i].at<double>(0), rotations[i].at<double>(1),
                            rotations[i].at<double>(2));
    const Eigen::Vector3d t(positions[i].at<double>(0), positions[i].at<double>(1),
                            positions[i].at<double>(2));
    if (r.allFinite() && t.allFinite() && t.z() > 0) result.X_SP.push_back(to_rigid(r, t));
  }
  return result;
}

// How far two rigid motions are apart, metres, with a lever of one metre for the rotation.
double distance(const Rigid& a, const Rigid& b) {
  return (a.position - b.position).norm() + a.rotation.angularDistance(b.rotation);
}

// The candidate most others agree with.
struct Vote {
  Rigid X;
  double median_distance = std::numeric_limits<double>::infinity();
};
Vote medoid(std::vector<std::vector<Rigid>> candidates_by_pose) {
  // The vote costs the square of the poses; some sixty, evenly taken, decide as well as thousands.
  constexpr std::size_t kVotersMax = 60;
  if (const std::size_t n = candidates_by_pose.size(); n > kVotersMax) {
    for (std::size_t i = 0; i < kVotersMax; ++i)
      candidates_by_pose[i] = candidates_by_pose[i * n / kVotersMax];
    candidates_by_pose.resize(kVotersMax);
  }
  Vote best;
  for (const auto& candidates : candidates_by_pose)
    for (const Rigid& candidate : candidates) {
      std::vector<double> distances;
      for (const auto& others : candidates_by_pose) {
        double nearest = std::numeric_limits<double>::infinity();
        for (const Rigid& other : others) nearest = std::min(nearest, distance(candidate, other));
        distances.push_back(nearest);
      }
      const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
      std::nth_element(distances.begin(), middle, distances.end());
      // Strictly better only: the first, which has the smallest reprojection error, wins ties.
      if (*middle < best.median_distance - 1e-12) best = {candidate, *middle};
    }
  return best;
}

class StartValues {
 public:
  explicit StartValues(Problem& problem) : problem_(problem) {}

  Result<void> find() {
    for (int i = 0; i < imager_count(); ++i)
      if (auto started = start_camera(problem_, i); !started) return started;
    for (std::size_t v = 0; v < problem_.views.size(); ++v)
      resections_.push_back(problem_.views[v].placed
                                ? resect(problem_, problem_.view_imager[v], problem_.views[v])
                                : Resection{});
    walk_the_graph();
    place_boards();
    repair_shifted_views();
    return express_in_reference();
  }

 private:
  int imager_count() const { return static_cast<int>(problem_.imagers.size()); }
  const std::vector<Rigid>& candidates(std::size_t view) const { return resections_[view].X_SP; }

  void walk_the_graph();
  void place_boards();
  void repair_shifted_views();
  Result<void> express_in_reference();
  double pose_cost(int pose, const Rigid& X_RP) const;
  bool try_renumbering(std::size_t view);
  void remark(std::size_t view, std::string_view what);

  Problem& problem_;
  std::vector<Resection> resections_;
  std::vector<Rigid> X_SR_;  // imager from the root imager
  std::vector<bool> imager_known_;
  std::vector<std::vector<std::size_t>> views_of_pose_;
  std::vector<Rigid> X_RP_;  // board pose in the root imager
  std::vector<bool> pose_known_;
};

void StartValues::walk_the_graph() {
  const auto n = static_cast<std::size_t>(imager_count());
  X_SR_.assign(n, Rigid{});
  imager_known_.assign(n, false);
  // views_of[pose][imager] = view
  std::map<int, std::map<int, std::size_t>> views_of;
  for (std::size_t v = 0; v < problem_.views.size(); ++v)
    if (!candidates(v).empty()) views_of[problem_.view_pose[v]][problem_.view_imager[v]] = v;
  struct Edge {
    int shared = 0;
    Vote vote;
  };
  std::map<std::pair<int, int>, Edge> edges;  // (a, b), a < b: X_ba
  for (int a = 0; a < imager_count(); ++a)
    for (int b = a + 1; b < imager_count(); ++b) {
      std::vector<std::vector<Rigid>> relative;
      for (const auto& [pose, by_imager] : views_of) {
        const auto va = by_imager.find(a), vb = by_imager.find(b);
        if (va == by_imager.end() || vb == by_imager.end()) continue;
        auto& list = relative.emplace_back();
        for (const Rigid& X_bP : candidates(vb->second))
          for (const Rigid& X_aP : candidates(va->second)) list.push_back(X_bP * X_aP.inverse());
      }
      if (!relative.empty()) edges[{a, b}] = {static_cast<int>(relative.size()), medoid(relative)};
    }
  // The imager with the most shared poses is the root; then always the strongest edge (Prim).
  std::vector<int> strength(n, 0);
  for (const auto& [pair, edge] : edges) {
    strength[static_cast<std::size_t>(pair.first)] += edge.shared;
    strength[static_cast<std::size_t>(pair.second)] += edge.shared;
  }
  const auto root = static_cast<std::size_t>(std::max_element(strength.begin(), strength.end()) -
                                             strength.begin());
  imager_known_[root] = true;
  for (;;) {
    const Edge* strongest = nullptr;
    std::pair<int, int> pair;
    for (const auto& [key, edge] : edges) {
      const bool known_a = imager_known_[static_cast<std::size_t>(key.first)];
      const bool known_b = imager_known_[static_cast<std::size_t>(key.second)];
      if (known_a == known_b) continue;
      if (strongest == nullptr || edge.shared > strongest->shared) {
        strongest = &edge;
        pair = key;
      }
    }
    if (strongest == nullptr) return;
    const auto a = static_cast<std::size_t>(pair.first), b = static_cast<std::size_t>(pair.second);
    if (imager_known_[a])
      X_SR_[b] = strongest->vote.X * X_SR_[a];
    else
      X_SR_[a] = strongest->vote.X.inverse() * X_SR_[b];
    imager_known_[a] = imager_known_[b] = true;
  }
}

double StartValues::pose_cost(int pose, const Rigid& X_RP) const {
  double cost = 0;
  for (const std::size_t v : views_of_pose_[static_cast<std::size_t>(pose)]) {
    const int imager = problem_.view_imager[v];
    if (!imager_known_[static_cast<std::size_t>(imager)]) continue;
    const Rigid X_SP = X_SR_[static_cast<std::size_t>(imager)] * X_RP;
    for (const Corner& corner : problem_.views[v].corners) {
      const double e = (reproject(problem_, imager, X_SP, corner.id) - corner.pixel).squaredNorm();
      constexpr double kScalePx = 5;
      cost += std::log1p(e / (kScalePx * kScalePx));
    }
  }
  return cost;
}

void StartValues::place_boards() {
  const std::size_t n = problem_.pose_names.size();
  views_of_pose_.assign(n, {});
  for (std::size_t v = 0; v < problem_.views.size(); ++v)
    views_of_pose_[static_cast<std::size_t>(problem_.view_pose[v])].push_back(v);
  X_RP_.assign(n, Rigid{});
  pose_known_.assign(n, false);
  std::vector<double> best(n, std::numeric_limits<double>::infinity());
  for (std::size_t v = 0; v < problem_.views.size(); ++v) {
    const auto pose = static_cast<std::size_t>(problem_.view_pose[v]);
    const auto imager = static_cast<std::size_t>(problem_.view_imager[v]);
    if (!imager_known_[imager]) continue;
    for (const Rigid& X_SP : candidates(v)) {
      const Rigid X_RP = X_SR_[imager].inverse() * X_SP;
      const double cost = pose_cost(static_cast<int>(pose), X_RP);
      if (cost >= best[pose]) continue;
      best[pose] = cost;
      X_RP_[pose] = X_RP;
      pose_known_[pose] = true;
    }
  }
}

double view_rms(const Problem& problem, std::size_t v, const Rigid& X_SP,
                const std::vector<Corner>& corners) {
  // The median, so that a few wrong IDs do not make a good view look bad.
  std::vector<double> errors;
  errors.reserve(corners.size());
  for (const Corner& corner : corners)
    errors.push_back(
        (reproject(problem, problem.view_imager[v], X_SP, corner.id) - corner.pixel).norm());
  if (errors.empty()) return std::numeric_limits<double>::infinity();
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  return *middle;
}

// From one corner to the next in the image, the median; 0 without neighbours.
double spacing_px(const Board& board, const std::vector<Corner>& corners) {
  std::map<int, Eigen::Vector2d> at;
  for (const Corner& corner : corners) at[corner.id] = corner.pixel;
  std::vector<double> lengths;
  for (const auto& [id, pixel] : at) {
    const auto right = at.find(id + 1), below = at.find(id + board.columns);
    if (right != at.end() && right->first % board.columns != 0)
      lengths.push_back((right->second - pixel).norm());
    if (below != at.end()) lengths.push_back((below->second - pixel).norm());
  }
  if (lengths.empty()) return 0;
  const auto middle = lengths.begin() + static_cast<std::ptrdiff_t>(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  return *middle;
}

// What somebody who clicks, or a detector that cannot tell a board's ends apart, gets wrong.
struct Renumbering {
  bool quarter = false;  // turned by 90 degrees: a part of a board may be counted across
  bool mirrored = false, turned = false;
  int row_shift = 0, column_shift = 0;
};

std::vector<Corner> renumbered(const Board& board, const std::vector<Corner>& corners,
                               const Renumbering& how) {
  std::vector<Corner> result;
  for (const Corner& corner : corners) {
    int row = corner.id / board.columns, column = corner.id % board.columns;
    if (how.quarter) row = std::exchange(column, -row);
    row += how.row_shift;
    column += how.column_shift;
    if (how.mirrored) column = board.columns - 1 - column;
    if (how.turned) row = board.rows - 1 - row, column = board.columns - 1 - column;
    if (row < 0 || row >= board.rows || column < 0 || column >= board.columns) continue;
    result.push_back({row * board.columns + column, corner.pixel});
  }
  return result;
}

std::string describe(const View& view) {
  return fmt::format("{} {}", view.imager, view.image.empty() ? view.pose : view.image);
}

std::string describe(const Renumbering& how) {
  std::string text;
  if (how.mirrored) text += "mirrored";
  if (how.turned) text += std::string(text.empty() ? "" : ", ") + "turned by 180 degrees";
  if (how.row_shift != 0 || how.column_shift != 0)
    text += fmt::format("{}shifted by {} rows and {} columns", text.empty() ? "" : ", ",
                        how.row_shift, how.column_shift);
  return text;
}

bool StartValues::try_renumbering(std::size_t v) {
  const Board& board = problem_.board;
  const auto imager = static_cast<std::size_t>(problem_.view_imager[v]);
  const Rigid X_SP = X_SR_[imager] * X_RP_[static_cast<std::size_t>(problem_.view_pose[v])];
  // A part of a board that was found without its place may begin anywhere, turned any way.
  const bool placed = problem_.views[v].placed;
  const int shift_max = placed ? 4 : std::max(board.rows, board.columns);
  double best = std::numeric_limits<double>::infinity();
  std::vector<Corner> best_corners;
  std::string best_text;
  // A board that is seen from behind is mirrored too, and rightly so: only a view that contradicts
  // the others gets here.
  for (const bool other : {false, true})
    for (const bool turned : {false, true})
      for (int dr = -shift_max; dr <= shift_max; ++dr)
        for (int dc = -shift_max; dc <= shift_max; ++dc) {
          const Renumbering renumbering{!placed && other, placed && other, turned, dr, dc};
          std::vector<Corner> corners = renumbered(board, problem_.views[v].corners, renumbering);
          if (corners.size() * 2 < problem_.views[v].corners.size()) continue;
          if (!placed && corners.size() != problem_.views[v].corners.size()) continue;
          const double error = view_rms(problem_, v, X_SP, corners);
          if (error >= best) continue;
          best = error;
          best_corners = std::move(corners);
          best_text = describe(renumbering);
        }
  constexpr double kAgreesPx = 5;
  if (best > kAgreesPx) return false;
  View& view = problem_.views[v];
  problem_.remarks.push_back(
      placed ? fmt::format("{}: the corner IDs are {} against the other views; they were corrected",
                           describe(view), best_text)
             : fmt::format("{}: shows a part of the board; its place on it was found by the other "
                           "views",
                           describe(view)));
  view.corners = std::move(best_corners);
  return true;
}

void StartValues::remark(std::size_t v, std::string_view what) {
  problem_.remarks.push_back(fmt::format("{}: {}", describe(problem_.views[v]), what));
}

void StartValues::repair_shifted_views() {
  constexpr double kWrongPx = 10;
  std::vector<bool> keep(problem_.views.size(), false);
  for (std::size_t v = 0; v < problem_.views.size(); ++v) {
    const View& view = problem_.views[v];
    const auto imager = static_cast<std::size_t>(problem_.view_imager[v]);
    const auto pose = static_cast<std::size_t>(problem_.view_pose[v]);
    const bool known = imager_known_[imager] && pose_known_[pose];
    // Less than a third of a square is the start values' own error, or a board that was moved: no
    // other ID explains it, and the adjustment itself leaves out what does not fit.
    const double wrong_px = std::max(kWrongPx, spacing_px(problem_.board, view.corners) / 3);
    keep[v] = known && view.placed &&
              view_rms(problem_, v, X_SR_[imager] * X_RP_[pose], view.corners) < wrong_px;
    if (keep[v]) continue;
    if (!known) {
      remark(v, view.placed ? "too few corners agree with a flat board; the view was left out"
                            : "shows a part of the board, and no other view of the pose tells "
                              "which; it was left out (click its corners)");
      continue;
    }
    keep[v] = try_renumbering(v);
    if (keep[v]) continue;
    keep[v] = problem_.keep_all && view.placed;
    if (keep[v])
      remark(v,
             "it contradicts the other views of its board pose; it was kept as all are (was "
             "the board or a camera moved?)");
    else
      remark(v,
             "it contradicts the other views of its board pose; it was left out (was the board "
             "or a camera moved?)");
  }
  std::size_t kept = 0;
  for (std::size_t v = 0; v < problem_.views.size(); ++v) {
    if (!keep[v]) continue;
    if (kept != v) problem_.views[kept] = std::move(problem_.views[v]);
    problem_.view_imager[kept] = problem_.view_imager[v];
    problem_.view_pose[kept] = problem_.view_pose[v];
    ++kept;
  }
  problem_.views.resize(kept);
  problem_.view_imager.resize(kept);
  problem_.view_pose.resize(kept);
}

Result<void> StartValues::express_in_reference() {
  std::vector<int> seen_by(problem_.pose_names.size(), 0);
  std::vector<int> views_of(problem_.imagers.size(), 0);
  for (std::size_t v = 0; v < problem_.views.size(); ++v) {
    ++seen_by[static_cast<std::size_t>(problem_.view_pose[v])];
    ++views_of[static_cast<std::size_t>(problem_.view_imager[v])];
  }
  for (std::size_t i = 0; i < views_of.size(); ++i)
    if (views_of[i] == 0)
      return fail(
          fmt::format("{}: no view of it can be used; photograph the board with it and at "
                      "least one other imager at once",
                      problem_.imagers[i].name));
  const auto reference =
      static_cast<std::size_t>(std::max_element(seen_by.begin(), seen_by.end()) - seen_by.begin());
  problem_.reference_pose = static_cast<int>(reference);
  const Rigid X_RB = X_RP_[reference];
  problem_.X_SB.clear();
  for (const Rigid& X_SR : X_SR_) problem_.X_SB.push_back(X_SR * X_RB);
  problem_.X_BP.clear();
  for (const Rigid& X_RP : X_RP_) problem_.X_BP.push_back(X_RB.inverse() * X_RP);
  problem_.X_BP[reference] = Rigid{};
  return {};
}

}  // namespace

Rigid to_rigid(const Eigen::Vector3d& rotation_vector, const Eigen::Vector3d& position) {
  const double angle = rotation_vector.norm();
  Rigid X;
  if (angle > 1e-15)
    X.rotation = Eigen::Quaterniond(Eigen::AngleAxisd(angle, rotation_vector / angle));
  X.position = position;
  return X;
}

Eigen::Vector3d rotation_vector(const Rigid& X) {
  const Eigen::AngleAxisd turn(X.rotation);
  return turn.angle() * turn.axis();
}

Eigen::Vector2d reproject(const Problem& problem, int imager, const Rigid& X_SP, int id) {
  const auto pixel =
      project(problem.cameras[static_cast<std::size_t>(imager)], X_SP * problem.board.point(id));
  return pixel.value_or(Eigen::Vector2d(1e6, 1e6));
}

Result<void> find_start_values(Problem& problem) {
  return StartValues(problem).find();
}

std::string describe_groups(const Problem& problem) {
  const std::size_t n = problem.imagers.size();
  std::vector<std::size_t> parent(n);
  std::iota(parent.begin(), parent.end(), std::size_t{0});
  const auto root = [&](std::size_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  std::map<int, std::size_t> first_of_pose;
  for (std::size_t v = 0; v < problem.views.size(); ++v) {
    if (!problem.views[v].placed) continue;
    const auto imager = static_cast<std::size_t>(problem.view_imager[v]);
    const auto [it, is_new] = first_of_pose.try_emplace(problem.view_pose[v], imager);
    if (!is_new) parent[root(imager)] = root(it->second);
  }
  std::map<std::size_t, std::string> groups;
  for (std::size_t i = 0; i < n; ++i) {
    std::string& text = groups[root(i)];
    text += (text.empty() ? "" : ", ") + problem.imagers[i].name;
  }
  if (groups.size() < 2) return {};
  std::string text;
  for (const auto& [key, names] : groups)
    text += fmt::format("{}[{}]", text.empty() ? "" : " and ", names);
  return text;
}

}  // namespace wagonsight::calibration
