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

// A Kinect's depth camera S as seen from the calibrated imager C; see depth_calibration.h.
struct DepthCalibration {
  bool from_infrared = false;
  Camera camera;  // of S; a pixel offset is in its centre already
  Rigid X_CS;     // identity for infrared
  // z = scale * reading + offset, in the board's metres (the georeference's scale comes on top).
  double scale = 1, offset_m = 0;
  Eigen::Vector2d pixel_offset = Eigen::Vector2d::Zero();  // infrared pixel minus depth pixel
  // Rotation of X_CS (small, in C, rad), its position (m), scale, offset (m), pixel offset (px);
  // zero where not estimated.
  Eigen::Matrix<double, 10, 10> covariance = Eigen::Matrix<double, 10, 10>::Zero();
  int views = 0, readings = 0;
  double rms_m = 0;         // of the readings from the boards' planes
  double mean_depth_m = 0;  // where the boards were
};

// What the Kinects' depth says of the board's stated size.
struct ScaleCheck {
  double square_m = 0, sigma_m = 0;
  bool agrees = true;  // within 2%
};

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
  double held_out_rms_px = 0;        // of a third of the views, unseen; 0: too few views
  std::optional<DepthCalibration> depth;

  // S, the frame of what the sensor measures: the depth camera where there is one.
  Camera measuring_camera() const { return depth ? depth->camera : camera; }
  Rigid measuring_X_BS() const { return depth ? X_BS * depth->X_CS : X_BS; }
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
  // Of X_BP, as ImagerSolution::covariance; zero for the reference pose.
  Matrix6 covariance = Matrix6::Zero();
};

// The two imagers of a stereo camera as one rigid body: what rectification and depth depend on.
struct StereoPair {
  std::string name;
  Rigid X_LR;  // the right imager's frame in the left one's
  // Of X_LR: small rotation in L (rad), then position in L (m).
  Matrix6 covariance = Matrix6::Zero();
  double baseline_m = 0, baseline_sigma_m = 0;
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
  std::vector<StereoPair> pairs;
  // Of all X_BS together, six rows an imager in their order: what differences of imagers (and so
  // what several of them see together) depend on. Empty: unknown.
  Eigen::MatrixXd joint_covariance;
  std::vector<ViewSolution> views;
  double sigma0_px = 0;  // standard deviation of one coordinate, from the residuals
  std::optional<ScaleCheck> scale_check;
  std::vector<std::string> remarks;  // wrong IDs, mirrored or shifted boards, weak views: sentences
  std::optional<Georeferenced> georeference;
};

// SOLUTION.json (see INTERFACES) and back.
std::string format_solution(const Solution& solution);
Result<Solution> parse_solution(std::string_view json, std::string_view file);

}  // namespace wagonsight
