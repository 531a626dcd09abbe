#include "calibrate/solve.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "calibrate/problem.h"
#include "calibrate/reprojection.h"

namespace wagonsight {
namespace {

using calibration::Adjustment;
using calibration::Observation;
using calibration::Problem;

Result<Problem> assemble(const Observations& observations, const std::vector<SensorSpec>& sensors) {
  Problem problem;
  problem.board = observations.board;
  problem.sensors = sensors;
  problem.imagers = imagers_of(sensors);
  problem.cameras.resize(problem.imagers.size());
  std::map<std::string, int> imager_of, pose_of;
  for (std::size_t i = 0; i < problem.imagers.size(); ++i)
    imager_of[problem.imagers[i].name] = static_cast<int>(i);
  for (const View& view : observations.views) {
    const auto imager = imager_of.find(view.imager);
    if (imager == imager_of.end())
      return fail(
          fmt::format("the view {} is of \"{}\", which no sensor is called; describe it or "
                      "remove its views",
                      view.image.empty() ? view.pose : view.image, view.imager));
    const SensorSpec& spec = problem.spec(imager->second);
    if (view.corners.empty()) {
      problem.remarks.push_back(
          fmt::format("{} {}: it has no corners; the view was left out", view.imager, view.image));
      continue;
    }
    std::set<int> seen;
    for (const Corner& corner : view.corners) {
      if (corner.id < 0 || corner.id >= problem.board.corner_count())
        return fail(fmt::format("{} {}: corner {} is not on the board (0 to {})", view.imager,
                                view.image, corner.id, problem.board.corner_count() - 1));
      if (!seen.insert(corner.id).second)
        return fail(
            fmt::format("{} {}: corner {} stands there twice", view.imager, view.image, corner.id));
      if (!(corner.pixel.x() >= -1 && corner.pixel.x() <= spec.width && corner.pixel.y() >= -1 &&
            corner.pixel.y() <= spec.height))
        return fail(
            fmt::format("{} {}: corner {} at ({}, {}) lies outside of the {} x {} image; is "
                        "the size in the sensors' file right?",
                        view.imager, view.image, corner.id, corner.pixel.x(), corner.pixel.y(),
                        spec.width, spec.height));
    }
    const auto [pose, is_new] = pose_of.try_emplace(view.pose, static_cast<int>(pose_of.size()));
    if (is_new) problem.pose_names.push_back(view.pose);
    problem.views.push_back(view);
    problem.view_imager.push_back(imager->second);
    problem.view_pose.push_back(pose->second);
  }
  for (std::size_t i = 0; i < problem.imagers.size(); ++i) {
    const auto seen =
        std::count(problem.view_imager.begin(), problem.view_imager.end(), static_cast<int>(i));
    if (seen == 0)
      return fail(fmt::format("{} has no view; photograph the board with it or leave it out",
                              problem.imagers[i].name));
  }
  const std::string groups = calibration::describe_groups(problem);
  if (!groups.empty())
    return fail(
        fmt::format("the rig falls apart into {}: photograph the board where a camera of each "
                    "group sees it at once",
                    groups));
  return problem;
}

void list_observations(Problem& problem) {
  for (std::size_t v = 0; v < problem.views.size(); ++v)
    for (const Corner& corner : problem.views[v].corners)
      problem.observations.push_back({problem.view_imager[v], problem.view_pose[v],
                                      static_cast<int>(v), corner.id, corner.pixel, true});
}

void tell_rejected(const Problem& problem, std::vector<std::string>& remarks) {
  std::vector<std::vector<int>> rejected(problem.views.size());
  for (const Observation& o : problem.observations)
    if (!o.used) rejected[static_cast<std::size_t>(o.view)].push_back(o.id);
  for (std::size_t v = 0; v < rejected.size(); ++v) {
    if (rejected[v].empty()) continue;
    std::sort(rejected[v].begin(), rejected[v].end());
    const View& view = problem.views[v];
    remarks.push_back(fmt::format(
        "{} {}: corners {} do not fit (wrong ID or badly clicked); they were left out", view.imager,
        view.image.empty() ? view.pose : view.image, fmt::join(rejected[v], ", ")));
  }
}

void tell_views(const Problem& problem, Solution& solution) {
  for (const View& view : problem.views) {
    ViewSolution& told = solution.views.emplace_back();
    told.imager = view.imager;
    told.image = view.image;
    told.pose = view.pose;
  }
  for (const Observation& o : problem.observations) {
    const Rigid X_SP = problem.X_SB[static_cast<std::size_t>(o.imager)] *
                       problem.X_BP[static_cast<std::size_t>(o.pose)];
    const Eigen::Vector2d residual =
        o.pixel - calibration::reproject(problem, o.imager, X_SP, o.id);
    solution.views[static_cast<std::size_t>(o.view)].residuals.push_back(
        {o.id, o.pixel, residual, o.used});
  }
  for (ViewSolution& view : solution.views) {
    double sum = 0, count = 0;
    for (const auto& r : view.residuals)
      if (r.used) sum += r.residual.squaredNorm(), count += 1;
    view.rms_px = count > 0 ? std::sqrt(sum / count) : 0;
  }
}

void tell_imagers(const Problem& problem, const Adjustment& adjustment,
                  const std::vector<double>& held_out, Solution& solution) {
  for (std::size_t i = 0; i < problem.imagers.size(); ++i) {
    ImagerSolution& told = solution.imagers.emplace_back();
    const SensorSpec& spec = problem.spec(static_cast<int>(i));
    told.name = problem.imagers[i].name;
    told.kind = spec.kind;
    told.camera = problem.cameras[i];
    told.camera.width = spec.width;
    told.camera.height = spec.height;
    told.intrinsics_fixed = spec.fix_intrinsics;
    told.X_BS = problem.X_SB[i].inverse();
    const auto at = 6 * static_cast<Eigen::Index>(i);
    told.covariance = adjustment.joint.block<6, 6>(at, at);
    told.sigma_intrinsics = adjustment.sigma_intrinsics[i];
    told.held_out_rms_px = held_out.empty() ? 0 : held_out[i];
    double sum = 0;
    for (std::size_t v = 0; v < solution.views.size(); ++v) {
      if (solution.views[v].imager != told.name) continue;
      for (const auto& r : solution.views[v].residuals) {
        if (!r.used) {
          ++told.rejected;
          continue;
        }
        ++told.corners;
        sum += r.residual.squaredNorm();
      }
    }
    told.rms_px = told.corners > 0 ? std::sqrt(sum / told.corners) : 0;
    told.rms_px_per_coordinate = told.rms_px / std::numbers::sqrt2;
  }
}

// X_LR = X_BL^-1 X_BR, and what the joint covariance makes of it.
void tell_pairs(const Problem& problem, Solution& solution) {
  for (std::size_t i = 0; i + 1 < problem.imagers.size(); ++i) {
    if (problem.imagers[i].sensor_index != problem.imagers[i + 1].sensor_index) continue;
    const Rigid &X_BL = solution.imagers[i].X_BS, &X_BR = solution.imagers[i + 1].X_BS;
    StereoPair& pair = solution.pairs.emplace_back();
    pair.name = problem.spec(static_cast<int>(i)).name;
    pair.X_LR = X_BL.inverse() * X_BR;
    const Eigen::Matrix3d R_t = X_BL.rotation.toRotationMatrix().transpose();
    const Eigen::Vector3d between = X_BR.position - X_BL.position;
    Eigen::Matrix<double, 6, 12> J = Eigen::Matrix<double, 6, 12>::Zero();
    J.block<3, 3>(0, 0) = -R_t;
    J.block<3, 3>(0, 6) = R_t;
    J.block<3, 3>(3, 0) = R_t * calibration::skew(between);
    J.block<3, 3>(3, 3) = -R_t;
    J.block<3, 3>(3, 9) = R_t;
    const auto at = 6 * static_cast<Eigen::Index>(i);
    pair.covariance = J * solution.joint_covariance.block<12, 12>(at, at) * J.transpose();
    pair.baseline_m = between.norm();
    const Eigen::Vector3d along = pair.X_LR.position / pair.baseline_m;
    pair.baseline_sigma_m = std::sqrt(along.dot(pair.covariance.bottomRightCorner<3, 3>() * along));
  }
}

}  // namespace

Result<Solution> solve(const Observations& observations, const std::vector<SensorSpec>& sensors,
                       const SolveOptions& options) {
  auto assembled = assemble(observations, sensors);
  if (!assembled) return fail(assembled.error().message);
  Problem problem = std::move(*assembled);
  problem.keep_all = options.reject_sigmas <= 0;
  if (auto started = calibration::find_start_values(problem); !started)
    return fail(started.error().message);
  list_observations(problem);
  std::vector<double> sigma_px;
  if (auto adjusted = calibration::adjust(problem, options.robust_px, options.reject_sigmas,
                                          options.iterations_max, sigma_px);
      !adjusted)
    return fail(adjusted.error().message);
  auto adjustment = calibration::covariances(problem, sigma_px);
  if (!adjustment) return fail(adjustment.error().message);
  std::vector<double> held_out;
  if (options.hold_out)
    held_out = calibration::held_out_errors(problem, sigma_px, options.iterations_max);
  Solution solution;
  solution.board = observations.board;
  solution.reference_pose = problem.pose_names[static_cast<std::size_t>(problem.reference_pose)];
  solution.sigma0_px = adjustment->sigma0_px;
  solution.remarks = problem.remarks;
  tell_rejected(problem, solution.remarks);
  tell_views(problem, solution);
  tell_imagers(problem, *adjustment, held_out, solution);
  for (std::size_t p = 0; p < problem.pose_names.size(); ++p)
    solution.poses.push_back({problem.pose_names[p], problem.X_BP[p], adjustment->poses[p]});
  solution.joint_covariance = adjustment->joint;
  tell_pairs(problem, solution);
  return solution;
}

}  // namespace wagonsight
