#include "calibrate/pack.h"

#include <fmt/format.h>

#include <Eigen/Geometry>

#include "calibrate/reprojection.h"
#include "stereo/rectify.h"

namespace wagonsight {
namespace {

using calibration::skew;

// Of X_BS where S is the depth camera: the imager's own and that of the way from it to S.
Matrix6 board_covariance(const ImagerSolution& imager) {
  if (!imager.depth) return imager.covariance;
  const Eigen::Matrix3d R = imager.X_BS.rotation.toRotationMatrix();
  Matrix6 from_imager = Matrix6::Identity();
  from_imager.bottomLeftCorner<3, 3>() = -skew(R * imager.depth->X_CS.position);
  Matrix6 turn = Matrix6::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = R;
  return from_imager * imager.covariance * from_imager.transpose() +
         turn * imager.depth->covariance.topLeftCorner<6, 6>() * turn.transpose();
}

// First-order propagation to (rotation in W, position in W) of X_WS.
Matrix6 world_covariance(const ImagerSolution& imager, const Similarity& X_WB,
                         const Eigen::Matrix<double, 7, 7>& georeference) {
  const Eigen::Matrix3d R = X_WB.rotation.toRotationMatrix();
  Matrix6 from_board = Matrix6::Zero();
  from_board.topLeftCorner<3, 3>() = R;
  from_board.bottomRightCorner<3, 3>() = X_WB.scale * R;
  const Eigen::Vector3d turned = R * imager.measuring_X_BS().position;
  Eigen::Matrix<double, 6, 7> from_world = Eigen::Matrix<double, 6, 7>::Zero();
  from_world.topLeftCorner<3, 3>().setIdentity();
  from_world.bottomLeftCorner<3, 3>() = -skew(X_WB.scale * turned);
  from_world.block<3, 3>(3, 3).setIdentity();
  from_world.bottomRightCorner<3, 1>() = turned;
  const Matrix6 covariance = from_board * board_covariance(imager) * from_board.transpose() +
                             from_world * georeference * from_world.transpose();
  return (covariance + covariance.transpose()) / 2;
}

// A stereo camera is one sensor whose S is the rectified left imager, exactly as the unit will
// rectify it; the lenses travel along for that.
Result<void> describe_pair(const ImagerSolution& left, const ImagerSolution& right, double scale,
                           RigSensor& sensor) {
  Rigid X_LR = left.X_BS.inverse() * right.X_BS;
  X_LR.position *= scale;
  const auto rectified = make_rectification(left.camera, right.camera, X_LR);
  if (!rectified) return fail(fmt::format("{}: {}", left.name, rectified.error().message));
  sensor.camera = rectified->camera;
  sensor.stereo = {rectified->baseline, left.camera, right.camera, X_LR};
  sensor.X_BS = left.X_BS * rectified->X_LS;
  sensor.rate_hz = 14;
  const double focal_baseline = sensor.camera.fx * sensor.stereo.baseline;
  sensor.noise.quantisation_per_z2 = 1.0 / (focal_baseline * 16);
  sensor.noise.c = 0.25 / focal_baseline;
  return {};
}

}  // namespace

Result<Rig> to_rig(const Solution& solution) {
  Rig rig;
  rig.provenance.made_by = "wagonsight-calibrate";
  Similarity X_WB;
  Eigen::Matrix<double, 7, 7> georeference = Eigen::Matrix<double, 7, 7>::Zero();
  if (solution.georeference) {
    X_WB = solution.georeference->X_WB;
    georeference = solution.georeference->covariance;
    rig.georeference.present = true;
    double sum = 0;
    for (const auto& r : solution.georeference->residuals_m) sum += r.squaredNorm();
    rig.georeference.rms_m = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(
                                                 1, solution.georeference->residuals_m.size())));
    rig.provenance.note = "georeferenced by targets";
  } else {
    X_WB.rotation =
        Eigen::Quaterniond(0, 1, 0, 0);  // half a turn about x: the board's z points down
    rig.provenance.note = "no georeference: the world is the board, z up";
  }
  rig.georeference.X_WB = X_WB;
  rig.georeference.covariance = georeference;
  for (std::size_t i = 0; i < solution.imagers.size(); ++i) {
    const ImagerSolution& imager = solution.imagers[i];
    RigSensor sensor;
    sensor.kind = imager.kind;
    std::string name = imager.name;
    sensor.camera = imager.measuring_camera();
    sensor.X_BS = imager.measuring_X_BS();
    if (imager.depth) {
      // The correction is to the board's metres; lambda takes those to the world's.
      sensor.depth_scale = X_WB.scale * imager.depth->scale;
      sensor.depth_offset = X_WB.scale * imager.depth->offset_m;
    }
    if (imager.kind == SensorKind::kStereo) {
      if (!name.ends_with(".left") || i + 1 >= solution.imagers.size())
        return fail(
            fmt::format("{}: a stereo camera needs its left and then its right imager", name));
      name.resize(name.size() - 5);
      const ImagerSolution& right = solution.imagers[++i];
      if (right.name != name + ".right")
        return fail(fmt::format("{}: its right imager is missing in the solution", name));
      if (auto described = describe_pair(imager, right, X_WB.scale, sensor); !described)
        return fail(described.error().message);
    }
    sensor.name = std::string_view(name);
    sensor.X_WS.rotation = (X_WB.rotation * sensor.X_BS.rotation).normalized();
    sensor.X_WS.position = X_WB * sensor.X_BS.position;
    sensor.rms_px = imager.rms_px;
    sensor.covariance = world_covariance(imager, X_WB, georeference);
    if (!rig.sensors.try_push_back(sensor))
      return fail(fmt::format("the solution has more than {} sensors", kSensorsMax));
  }
  return rig;
}

}  // namespace wagonsight
