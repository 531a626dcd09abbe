// How well the calibration predicts what it has not seen.
#include <algorithm>
#include <cmath>

#include "calibrate/problem.h"
#include "calibrate/reprojection.h"

namespace wagonsight::calibration {
namespace {

constexpr std::size_t kFold = 3;        // a third of the views is hidden
constexpr std::size_t kCornersMin = 8;  // of a hidden view

// Places a board by the corners of its hidden views whose ID is even: Gauss-Newton from where the
// full solution had it. False when they do not determine it.
bool place_board(Problem& problem, std::size_t pose, const std::vector<const Observation*>& seen) {
  constexpr int kIterations = 10;
  PoseBlock X_BP = to_block(problem.X_BP[pose]);
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    Matrix6 N = Matrix6::Zero();
    Eigen::Matrix<double, 6, 1> g = Eigen::Matrix<double, 6, 1>::Zero();
    for (const Observation* o : seen) {
      const auto imager = static_cast<std::size_t>(o->imager);
      const PoseBlock X_SB = to_block(problem.X_SB[imager]);
      const IntrinsicsBlock k = to_block(problem.cameras[imager]);
      Eigen::Vector2d pixel;
      PixelJacobians J;
      if (!ViewProjection(X_SB.data(), X_BP.data(), k.data())
               .project(problem.board.point(o->id), pixel, &J))
        return false;
      N += J.X_BP.transpose() * J.X_BP;
      g += J.X_BP.transpose() * (o->pixel - pixel);
    }
    const Eigen::LDLT<Matrix6> factor(N);
    if (factor.info() != Eigen::Success || factor.rcond() < 1e-14) return false;
    const Eigen::Matrix<double, 6, 1> step = factor.solve(g);
    for (std::size_t i = 0; i < 6; ++i) X_BP[i] += step[static_cast<Eigen::Index>(i)];
    if (step.norm() < 1e-12) break;
  }
  problem.X_BP[pose] = to_rigid(X_BP);
  return true;
}

// Every third view of an imager, beginning with the second, unless it would be its last or the
// reference pose's, which defines B.
std::vector<bool> choose_views(const Problem& problem) {
  std::vector<std::size_t> corners(problem.views.size(), 0), count(problem.imagers.size(), 0);
  for (const Observation& o : problem.observations)
    if (o.used) ++corners[static_cast<std::size_t>(o.view)];
  std::vector<bool> hidden(problem.views.size(), false);
  for (std::size_t v = 0; v < hidden.size(); ++v) {
    const auto imager = static_cast<std::size_t>(problem.view_imager[v]);
    if (problem.view_pose[v] == problem.reference_pose || corners[v] < kCornersMin) continue;
    // Imagers begin at different views, so that a board pose keeps some of its views.
    hidden[v] = (count[imager]++ + imager) % kFold == 1;
  }
  return hidden;
}

}  // namespace

std::vector<double> held_out_errors(const Problem& problem, const std::vector<double>& sigma_px,
                                    int iterations_max) {
  const std::vector<bool> is_hidden = choose_views(problem);
  Problem rest = problem;
  std::vector<double> errors(problem.imagers.size(), 0.0), count(problem.imagers.size(), 0.0);
  std::vector<std::vector<const Observation*>> judges(problem.pose_names.size());
  std::vector<bool> placed(problem.pose_names.size(), false);
  std::vector<int> left(problem.imagers.size(), 0);
  for (std::size_t i = 0; i < rest.observations.size(); ++i) {
    Observation& o = rest.observations[i];
    if (!o.used) continue;
    if (!is_hidden[static_cast<std::size_t>(o.view)]) {
      placed[static_cast<std::size_t>(o.pose)] = true;
      ++left[static_cast<std::size_t>(o.imager)];
      continue;
    }
    o.used = false;
    judges[static_cast<std::size_t>(o.pose)].push_back(&problem.observations[i]);
  }
  constexpr int kLeftMin = 50;  // corners that an imager keeps
  if (std::any_of(left.begin(), left.end(), [](int n) { return n < kLeftMin; })) return errors;
  if (!run(rest, sigma_px, {0, iterations_max, 1e-8})) return errors;
  for (std::size_t p = 0; p < judges.size(); ++p) {
    std::vector<const Observation*> places;
    if (!placed[p])
      for (const Observation* o : judges[p])
        if (o->id % 2 == 0) places.push_back(o);
    if (!placed[p] && (places.size() < 4 || !place_board(rest, p, places))) continue;
    for (const Observation* o : judges[p]) {
      if (!placed[p] && o->id % 2 == 0) continue;
      errors[static_cast<std::size_t>(o->imager)] += residual_of(rest, *o).squaredNorm();
      count[static_cast<std::size_t>(o->imager)] += 1;
    }
  }
  for (std::size_t i = 0; i < errors.size(); ++i)
    errors[i] = count[i] > 0 ? std::sqrt(errors[i] / count[i]) : 0.0;
  return errors;
}

}  // namespace wagonsight::calibration
