#include "calibrate/pack.h"

#include <fmt/format.h>

#include <Eigen/Geometry>

namespace wagonsight {
namespace {

Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d S;
  S << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return S;
}

// First-order propagation to (rotation in W, position in W) of X_WS.
Matrix6 world_covariance(const ImagerSolution& imager, const Similarity& X_WB,
                         const Eigen::Matrix<double, 7, 7>& georeference) {
  const Eigen::Matrix3d R = X_WB.rotation.toRotationMatrix();
  Matrix6 from_board = Matrix6::Zero();
  from_board.topLeftCorner<3, 3>() = R;
  from_board.bottomRightCorner<3, 3>() = X_WB.scale * R;
  const Eigen::Vector3d turned = R * imager.X_BS.position;
  Eigen::Matrix<double, 6, 7> from_world = Eigen::Matrix<double, 6, 7>::Zero();
  from_world.topLeftCorner<3, 3>().setIdentity();
  from_world.bottomLeftCorner<3, 3>() = -skew(X_WB.scale * turned);
  from_world.block<3, 3>(3, 3).setIdentity();
  from_world.bottomRightCorner<3, 1>() = turned;
  return from_board * imager.covariance * from_board.transpose() +
         from_world * georeference * from_world.transpose();
}

// The orientation both rectified imagers of a pair share: x along the baseline, z as near as can be
// to the mean of both optical axes (Fusiello, Trucco and Verri 2000).
Eigen::Quaterniond rectified_rotation(const Rigid& X_BL, const Rigid& X_BR) {
  const Eigen::Vector3d x = (X_BR.position - X_BL.position).normalized();
  const Eigen::Vector3d forward =
      X_BL.rotation * Eigen::Vector3d::UnitZ() + X_BR.rotation * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d y = forward.cross(x).normalized();
  Eigen::Matrix3d R;
  R.col(0) = x;
  R.col(1) = y;
  R.col(2) = x.cross(y);
  return Eigen::Quaterniond(R).normalized();
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
    sensor.camera = imager.camera;
    sensor.X_BS = imager.X_BS;
    if (imager.kind == SensorKind::kStereo) {
      if (!name.ends_with(".left") || i + 1 >= solution.imagers.size())
        return fail(
            fmt::format("{}: a stereo camera needs its left and then its right imager", name));
      name.resize(name.size() - 5);
      const ImagerSolution& right = solution.imagers[++i];
      if (right.name != name + ".right")
        return fail(fmt::format("{}: its right imager is missing in the solution", name));
      sensor.stereo.baseline = X_WB.scale * (right.X_BS.position - imager.X_BS.position).norm();
      sensor.X_BS.rotation = rectified_rotation(imager.X_BS, right.X_BS);
      // The rectified image keeps the size and the mean focal length; it has no distortion.
      const double focal = (imager.camera.fy + right.camera.fy) / 2;
      sensor.camera.fx = sensor.camera.fy = focal;
      sensor.camera.cx = (imager.camera.cx + right.camera.cx) / 2;
      sensor.camera.cy = (imager.camera.cy + right.camera.cy) / 2;
      sensor.camera.distortion = {};
      sensor.rate_hz = 14;
      sensor.noise.quantisation_per_z2 = 1.0 / (focal * sensor.stereo.baseline * 16);
      sensor.noise.c = 0.25 / (focal * sensor.stereo.baseline);
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
