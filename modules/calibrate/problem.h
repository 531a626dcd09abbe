#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "calibrate/imagers.h"
#include "calibrate/observations.h"
#include "calibrate/solution.h"
#include "geometry/transform.h"

// The inside of solve(): shared by its steps, not for users.
namespace wagonsight::calibration {

struct Observation {
  int imager = 0, pose = 0, view = 0, id = 0;
  Eigen::Vector2d pixel;
  bool used = true;
};

struct Problem {
  Board board;
  std::vector<SensorSpec> sensors;
  std::vector<Imager> imagers;
  std::vector<Camera> cameras;  // by imager
  std::vector<Rigid> X_SB;      // by imager
  std::vector<std::string> pose_names;
  std::vector<Rigid> X_BP;  // by pose
  std::vector<View> views;  // IDs may be corrected
  std::vector<int> view_imager, view_pose;
  std::vector<Observation> observations;
  int reference_pose = 0;
  std::vector<std::string> remarks;

  const SensorSpec& spec(int imager) const {
    return sensors[static_cast<std::size_t>(
        imagers[static_cast<std::size_t>(imager)].sensor_index)];
  }
};

Rigid to_rigid(const Eigen::Vector3d& rotation_vector, const Eigen::Vector3d& position);
Eigen::Vector3d rotation_vector(const Rigid& X);

// Pixel of a board point, far outside of the image when it lies behind the imager.
Eigen::Vector2d reproject(const Problem& problem, int imager, const Rigid& X_SP, int id);

// Start values of cameras (where none are given), X_SB and X_BP.
Result<void> find_start_values(Problem& problem);

// Names groups of imagers that share no board pose; an empty text when all hang together.
std::string describe_groups(const Problem& problem);

struct Adjustment {
  double sigma0_px = 0;
  std::vector<double> imager_sigma_px;  // by imager
  std::vector<Matrix6> covariance;      // of X_BS by imager, see ImagerSolution
  std::vector<Eigen::Vector4d> sigma_intrinsics;
};
// Robust adjustment, rejection of gross errors, weighted least squares.
Result<void> adjust(Problem& problem, double robust_px, double reject_sigmas, int iterations_max,
                    std::vector<double>& imager_sigma_px);
Result<Adjustment> covariances(Problem& problem, const std::vector<double>& imager_sigma_px);

// Root mean square reprojection error by imager of corners that the adjustment had not seen.
std::vector<double> held_out_errors(const Problem& problem, double robust_px, int iterations_max);

}  // namespace wagonsight::calibration
