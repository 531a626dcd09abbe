#include "rig/stereo_pair.h"

#include <Eigen/Geometry>
#include <string>

#include "base/capacities.h"

namespace wagonsight {
namespace {

// The pixel of the middle of `source`'s image on a plane of focal length f without a centre.
Eigen::Vector2d middle_on_plane(const Camera& source, const Eigen::Matrix3d& R_rectified_source,
                                double focal) {
  const Eigen::Vector2d middle((source.width - 1) / 2.0, (source.height - 1) / 2.0);
  const Eigen::Vector3d ray =
      R_rectified_source * ray_through(source, middle).value_or(Eigen::Vector3d::UnitZ());
  return focal * ray.head<2>() / ray.z();
}

}  // namespace

Result<RectifiedPair> rectified_pair(const Camera& left, const Camera& right, const Rigid& X_LR,
                                     double zoom) {
  const auto size = [](const Camera& c) {
    return std::to_string(c.width) + " x " + std::to_string(c.height);
  };
  if (left.width != right.width || left.height != right.height)
    return fail("the imagers of a stereo pair differ in size (" + size(left) + " and " +
                size(right) + "); give two cameras of one size");
  if (left.width < 2 || left.height < 2 ||
      static_cast<std::size_t>(left.width) * static_cast<std::size_t>(left.height) >
          kImagePixelsMax)
    return fail("a stereo pair cannot be rectified at " + size(left) + " pixels");
  const Eigen::Matrix3d R_LR = X_LR.rotation.toRotationMatrix();
  const double baseline = X_LR.position.norm();
  const Eigen::Vector3d x = X_LR.position / baseline;
  if (!(baseline > 1e-6) || x.x() < 0.5)
    return fail("the right imager is not to the right of the left one (its place is x = " +
                std::to_string(X_LR.position.x()) + " m, y = " + std::to_string(X_LR.position.y()) +
                " m there); exchange the imagers");
  const Eigen::Vector3d axis = (Eigen::Vector3d::UnitZ() + R_LR.col(2)).normalized();
  const Eigen::Vector3d y = axis.cross(x).normalized();
  Eigen::Matrix3d R_LS;
  R_LS << x, y, x.cross(y);
  const Eigen::Matrix3d R_RS = R_LR.transpose() * R_LS;

  RectifiedPair result;
  Camera& camera = result.camera;
  camera.width = left.width;
  camera.height = left.height;
  camera.fx = camera.fy = zoom * (left.fx + left.fy + right.fx + right.fy) / 4;
  const Eigen::Vector2d middle = (middle_on_plane(left, R_LS.transpose(), camera.fx) +
                                  middle_on_plane(right, R_RS.transpose(), camera.fx)) /
                                 2;
  camera.cx = (camera.width - 1) / 2.0 - middle.x();
  camera.cy = (camera.height - 1) / 2.0 - middle.y();
  result.baseline = baseline;
  result.X_LS = {Eigen::Quaterniond(R_LS), Eigen::Vector3d::Zero()};
  result.X_RS = X_LR.inverse() * result.X_LS;
  return result;
}

}  // namespace wagonsight
