#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "calibrate/imagers.h"
#include "calibrate/observations.h"
#include "geometry/camera.h"
#include "geometry/transform.h"

namespace wagonsight {

using Matrix6 = Eigen::Matrix<double, 6, 6>;

// A solved imager. Residuals are measured minus reprojected, pixels.
struct ImagerSolution {
  std::string name;
  SensorKind kind = SensorKind::kKinect;
  Camera camera;
  bool intrinsics_fixed = false;
  Rigid X_BS;
  // Of X_BS: small rotation in B (rad, X = exp(rotation) X_BS), then position in B (m).
  Matrix6 covariance = Matrix6::Zero();
  // Standard deviations of fx, fy, cx, cy; what was stated when they are fixed.
  Eigen::Vector4d sigma_intrinsics = Eigen::Vector4d::Zero();
  int corners = 0;
  int rejected = 0;
  double rms_px = 0;                 // root mean square of the residuals' lengths
  double rms_px_per_coordinate = 0;  // rms_px / sqrt(2)
  double held_out_rms_px = 0;        // of corners the solution had not seen; 0: too few views
};

struct ViewSolution {
  std::string imager, image, pose;
  double rms_px = 0;
  struct Residual {
    int id = 0;
    Eigen::Vector2d pixel, residual;
    bool used = true;
  };
  std::vector<Residual> residuals;
};

struct BoardPose {
  std::string name;
  Rigid X_BP;  // of this pose's board to the reference pose, which defines B
};

struct Georeferenced {
  Similarity X_WB;  // the paper's equation 7
  Eigen::Matrix<double, 7, 7> covariance = Eigen::Matrix<double, 7, 7>::Zero();  // see Georeference
  std::vector<std::string> targets;
  std::vector<Eigen::Vector3d> residuals_m;  // reference minus transformed, W
};

struct Solution {
  Board board;
  std::string reference_pose;
  std::vector<ImagerSolution> imagers;
  std::vector<BoardPose> poses;
  std::vector<ViewSolution> views;
  double sigma0_px = 0;              // standard deviation of one coordinate, from the residuals
  std::vector<std::string> remarks;  // wrong IDs, mirrored or shifted boards, weak views: sentences
  std::optional<Georeferenced> georeference;
};

// SOLUTION.json (see INTERFACES) and back.
std::string format_solution(const Solution& solution);
Result<Solution> parse_solution(std::string_view json, std::string_view file);

}  // namespace wagonsight
