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
  bool keep_all = false;  // no view that contradicts the others is left out

  const SensorSpec& spec(int imager) const {
    return sensors[static_cast<std::size_t>(
        imagers[static_cast<std::size_t>(imager)].sensor_index)];
  }
};

Rigid to_rigid(const Eigen::Vector3d& rotation_vector, const Eigen::Vector3d& position);
Eigen::Vector3d rotation_vector(const Rigid& X);

// Pixel of a board point, far outside of the image when it lies behind the imager.
Eigen::Vector2d reproject(const Problem& problem, int imager, const Rigid& X_SP, int id);

// Corners of a view that agree with one homography (wrong IDs mostly do not); empty below four.
std::vector<Corner> consistent_corners(const Board& board, const View& view);
// False when the corners lie on one line, which fixes no pose.
bool spans_the_plane(const Board& board, const std::vector<Corner>& corners);
Result<void> start_camera(Problem& problem, int imager);

// Start values of cameras (where none are given), X_SB and X_BP.
Result<void> find_start_values(Problem& problem);

// Names groups of imagers that share no board pose; an empty text when all hang together.
std::string describe_groups(const Problem& problem);

// Standard deviations the distortion coefficients k1, k2, p1, p2, k3 are held to zero with: no lens
// of these has coefficients beyond about one, and a camera that sees the board in one corner only
// must not invent them.
inline constexpr std::array<double, 5> kDistortionSigma = {2.0, 4.0, 0.1, 0.1, 4.0};

// The two imagers of a stereo camera whose distance was stated.
struct KnownBaseline {
  std::size_t left = 0, right = 0;
  double baseline_m = 0, sigma_m = 0;
};
std::vector<KnownBaseline> known_baselines(const Problem& problem);

// Measured minus reprojected, pixels.
Eigen::Vector2d residual_of(const Problem& problem, const Observation& observation);

// One adjustment from where `problem` is, corners weighed by their imager's noise. `robust_px` is
// the scale of a Cauchy loss, 0: plain least squares.
struct RunOptions {
  double robust_px = 0;
  int iterations_max = 100;
  double tolerance = 1e-10;  // of the cost, relative
};
Result<void> run(Problem& problem, const std::vector<double>& sigma_px, const RunOptions& options);

// Robust adjustment, rejection of gross errors, weighted least squares.
Result<void> adjust(Problem& problem, double robust_px, double reject_sigmas, int iterations_max,
                    std::vector<double>& imager_sigma_px);

struct Adjustment {
  double sigma0_px = 0;
  std::vector<double> imager_sigma_px;  // by imager
  Eigen::MatrixXd joint;                // of all X_BS, 6 an imager, see Solution
  std::vector<Matrix6> poses;           // of X_BP by pose, see BoardPose
  std::vector<Eigen::Vector4d> sigma_intrinsics;
};
Result<Adjustment> covariances(const Problem& problem, const std::vector<double>& imager_sigma_px);

// Root mean square reprojection error by imager of a third of the views, which the adjustment had
// not seen: where a board was seen by other imagers too they place it, else half of its corners do
// and the other half judges. Zero where there is too little.
std::vector<double> held_out_errors(const Problem& problem, const std::vector<double>& sigma_px,
                                    int iterations_max);

}  // namespace wagonsight::calibration
