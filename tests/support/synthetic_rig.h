#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "calibrate/solve.h"
#include "geometry/angles.h"

// The rig of the paper with known truth: four Kinects and six stereo cameras under the ceiling, one
// board on the floor and many tilted ones, corners with noise and gross errors.
namespace wagonsight::synthetic {

struct Options {
  double noise_px = 0.25;
  double gross_share = 0.0;
  double hidden_share = 0.1;
  int poses = 40;
  int kinects = 4;
  int stereos = 6;
  bool fix_kinects = true;
  // Fixed intrinsics are wrong by this, and say so.
  double focal_sigma = 0;  // relative
  double centre_sigma_px = 0;
  bool start_values = false;  // of the stereo cameras too
  bool flat_view = false;     // the last stereo camera sees the boards at a flat angle
};

struct RigWithTruth {
  std::vector<SensorSpec> sensors;
  std::vector<Camera> cameras;  // by imager
  std::vector<Rigid> X_BS;
  std::vector<Rigid> X_BP;  // by pose, "p0" is B
  Observations observations;
};

inline RigWithTruth make(unsigned seed, const Options& options) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0, 1);
  RigWithTruth rig;
  const auto add_sensor = [&](const std::string& name, SensorKind kind, const Rigid& X_BS) {
    SensorSpec spec;
    spec.name = name;
    spec.kind = kind;
    const bool is_stereo = kind == SensorKind::kStereo;
    spec.width = is_stereo ? 769 : 640;
    spec.height = is_stereo ? 448 : 480;
    Camera camera{spec.width,
                  spec.height,
                  is_stereo ? 520.0 : 525.0,
                  is_stereo ? 520.0 : 525.0,
                  spec.width / 2.0 - 0.5,
                  spec.height / 2.0 - 0.5,
                  {}};
    camera.fx += 8 * (uniform(random) - 0.5);
    camera.fy = camera.fx + uniform(random) - 0.5;
    camera.cx += 10 * (uniform(random) - 0.5);
    camera.cy += 10 * (uniform(random) - 0.5);
    if (is_stereo) camera.distortion = {-0.12, 0.06, 0.0008, -0.0005, 0.0};
    if (is_stereo && options.start_values) spec.start = camera;
    if (!is_stereo && options.fix_kinects) {
      spec.fix_intrinsics = true;
      spec.start = camera;
      spec.fixed_sigma_focal = options.focal_sigma;
      spec.fixed_sigma_centre_px = options.centre_sigma_px;
      spec.start->fx *= 1 + options.focal_sigma * normal(random);
      spec.start->fy *= 1 + options.focal_sigma * normal(random);
      spec.start->cx += options.centre_sigma_px * normal(random);
      spec.start->cy += options.centre_sigma_px * normal(random);
    }
    rig.sensors.push_back(spec);
    rig.cameras.push_back(camera);
    rig.X_BS.push_back(X_BS);
    if (is_stereo) {
      rig.cameras.push_back(camera);
      rig.cameras.back().cx += 2;
      Rigid right = X_BS;
      right.position += X_BS.rotation * Eigen::Vector3d(0.08, 0, 0);
      rig.X_BS.push_back(right);
    }
  };
  // The board lies on the floor with its z down, so heights are negative z in B.
  const auto pose_at = [&](double x, double y, double height) {
    const Eigen::Vector3d position(x, y, height);
    const Rigid X_FS{
        look_at(position, Eigen::Vector3d(0.2 * normal(random), 0.2 * normal(random), 0.3)),
        position};
    const Rigid X_BF{Eigen::Quaterniond(0, 1, 0, 0), Eigen::Vector3d(0.3, 0.2, 0)};
    return X_BF * X_FS;
  };
  for (int k = 0; k < options.kinects; ++k) {
    const double turn = 2 * 3.14159265 * (k + 0.5) / std::max(1, options.kinects);
    add_sensor("k" + std::to_string(k), SensorKind::kKinect,
               pose_at(1.6 * std::cos(turn), 1.2 * std::sin(turn), 2.3));
  }
  for (int s = 0; s < options.stereos; ++s) {
    const double turn = 2 * 3.14159265 * s / std::max(1, options.stereos);
    const double height = options.flat_view && s == options.stereos - 1 ? 0.7 : 2.3;
    add_sensor("s" + std::to_string(s), SensorKind::kStereo,
               pose_at(1.5 * std::cos(turn), 1.1 * std::sin(turn), height));
  }
  const std::vector<Imager> imagers = imagers_of(rig.sensors);
  rig.observations.board = {6, 9, 0.08};
  const Board& board = rig.observations.board;
  for (int p = 0; p < options.poses; ++p) {
    Rigid X_BP;
    if (p > 0) {
      const Eigen::Vector3d axis =
          Eigen::Vector3d(normal(random), normal(random), 0.3 * normal(random)).normalized();
      X_BP.rotation = Eigen::AngleAxisd(0.5 * uniform(random) + 0.1, axis);
      X_BP.position = {0.6 * (uniform(random) - 0.5), 0.6 * (uniform(random) - 0.5),
                       -0.6 * uniform(random)};
    }
    rig.X_BP.push_back(X_BP);
    for (std::size_t i = 0; i < imagers.size(); ++i) {
      View view;
      view.imager = imagers[i].name;
      view.pose = "p" + std::to_string(p);
      view.image = view.imager + "/" + view.pose + ".png";
      const Rigid X_SP = rig.X_BS[i].inverse() * X_BP;
      for (int id = 0; id < board.corner_count(); ++id) {
        const auto pixel = project(rig.cameras[i], X_SP * board.point(id));
        const double nx = normal(random), ny = normal(random), hide = uniform(random),
                     gross = uniform(random);
        if (!pixel || pixel->x() < 2 || pixel->y() < 2 || pixel->x() > rig.cameras[i].width - 3 ||
            pixel->y() > rig.cameras[i].height - 3 || hide < options.hidden_share)
          continue;
        Eigen::Vector2d seen = *pixel + options.noise_px * Eigen::Vector2d(nx, ny);
        if (gross < options.gross_share)
          seen += Eigen::Vector2d(uniform(random) > 0.5 ? 15 : -15, 20 * (uniform(random) - 0.5));
        seen = seen.cwiseMax(0).cwiseMin(
            Eigen::Vector2d(rig.cameras[i].width - 1, rig.cameras[i].height - 1));
        view.corners.push_back({id, seen});
      }
      if (view.corners.size() >= 8) rig.observations.views.push_back(view);
    }
  }
  return rig;
}

// A solution that is the truth, so that what follows a solution is tested alone.
inline Solution true_solution(const RigWithTruth& rig) {
  Solution solution;
  solution.sigma0_px = 0.1;
  const auto imagers = imagers_of(rig.sensors);
  for (std::size_t i = 0; i < imagers.size(); ++i) {
    ImagerSolution imager;
    imager.name = imagers[i].name;
    imager.kind = rig.sensors[static_cast<std::size_t>(imagers[i].sensor_index)].kind;
    imager.camera = rig.cameras[i];
    imager.X_BS = rig.X_BS[i];
    solution.imagers.push_back(imager);
  }
  return solution;
}

}  // namespace wagonsight::synthetic
