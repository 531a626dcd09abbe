#include "calibrate/depth_targets.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>

#include "calibrate/ball_centre.h"
#include "calibrate/reprojection.h"

namespace wagonsight {
namespace {

// Roughly, in the frame of the imager that was clicked in.
std::optional<Eigen::Vector3d> expected_centre(const Solution& solution,
                                               const ImagerSolution& imager, const Target& target,
                                               const Target::Sighting& sighting, double radius_m) {
  if (sighting.outline) {
    const auto ball = ball_centre(imager.camera, *sighting.outline, radius_m);
    const auto ray = ray_through(imager.camera, sighting.pixel);
    if (ball && ball->distance_m && ray)
      return Eigen::Vector3d(*ball->distance_m * ray->normalized());
  }
  Target by_rays = target;
  by_rays.spheres.clear();
  const auto point = triangulate(solution, by_rays);
  if (!point) return std::nullopt;
  return Eigen::Vector3d(imager.X_BS.inverse() * point->p_B);
}

// Of a point that the depth camera measures, in the imager's frame: what the calibration of X_CS,
// of the readings and of the pixels leaves open (see DepthCalibration::covariance).
Eigen::Matrix3d calibration_covariance(const DepthCalibration& depth, const Eigen::Vector3d& p_S) {
  const Eigen::Matrix3d turn = depth.X_CS.rotation.toRotationMatrix();
  const Eigen::Vector3d along = turn * p_S / p_S.z();
  Eigen::Matrix<double, 3, 10> J;
  J.leftCols<3>() = -calibration::skew(turn * p_S);
  J.middleCols<3>(3).setIdentity();
  J.col(6) = along * (p_S.z() - depth.offset_m) / depth.scale;
  J.col(7) = along;
  J.col(8) = turn.col(0) * p_S.z() / depth.camera.fx;
  J.col(9) = turn.col(1) * p_S.z() / depth.camera.fy;
  return J * depth.covariance * J.transpose();
}

// The cap of a ball is fitted well enough by a sphere of another radius that the depth alone does
// not tell; the outline and the distance do. Also finds another ball than the one that was clicked.
Result<void> check_ball(const ImagerSolution& imager, const Target::Sighting& sighting,
                        const Eigen::Vector3d& p_C, double radius_m) {
  const double radius_px = imager.camera.fx * radius_m / p_C.z();
  const auto seen = project(imager.camera, p_C);
  const double off_px = seen ? (*seen - sighting.pixel).norm() : radius_px;
  if (off_px > std::max(3.0, radius_px / 2))
    return fail(
        fmt::format("{}: the ball in its depth lies {:.0f} px from the one that was clicked",
                    imager.name, off_px));
  if (!sighting.outline) return {};
  const auto ball = ball_centre(imager.camera, *sighting.outline, radius_m);
  if (!ball || !ball->distance_m) return {};
  const double size = p_C.norm() / *ball->distance_m;  // by the outline, as a share of the stated
  constexpr double kSizeTolerance = 0.15, kOutline_px = 1.5;
  if (std::abs(size - 1) > kSizeTolerance + kOutline_px / radius_px)
    return fail(fmt::format("{}: the outline is that of a ball of {:.0f} mm radius, not {:.0f} mm",
                            imager.name, size * radius_m * 1e3, radius_m * 1e3));
  return {};
}

}  // namespace

Result<DepthTarget> sphere_in_depth(const Solution& solution, const Target& target,
                                    const Target::Sighting& sighting, const DepthImage& image,
                                    double radius_m) {
  const auto imager =
      std::find_if(solution.imagers.begin(), solution.imagers.end(),
                   [&](const ImagerSolution& one) { return one.name == sighting.imager; });
  if (imager == solution.imagers.end())
    return fail(fmt::format("\"{}\" is not in the solution", sighting.imager));
  if (!imager->depth)
    return fail(fmt::format("{}: its depth camera is not calibrated; solve with the depth images",
                            imager->name));
  const DepthCalibration& depth = *imager->depth;
  if (image.width != depth.camera.width || image.height != depth.camera.height)
    return fail(fmt::format("{}: its depth image has {} x {} pixels, its depth camera {} x {}",
                            imager->name, image.width, image.height, depth.camera.width,
                            depth.camera.height));
  const auto expected = expected_centre(solution, *imager, target, sighting, radius_m);
  if (!expected)
    return fail(
        fmt::format("{}: how far away the ball is cannot be told; click on it with its "
                    "outline, or in another image too",
                    imager->name));
  const auto near = project(depth.camera, depth.X_CS.inverse() * *expected);
  if (!near ||
      !(near->x() >= 0 && near->y() >= 0 && near->x() < image.width && near->y() < image.height))
    return fail(fmt::format("{}: the ball lies outside of its depth image", imager->name));
  const auto fit = fit_sphere(image, *imager, *near, radius_m);
  if (!fit) return fail(fit.error().message);
  if (auto sound = check_ball(*imager, sighting, depth.X_CS * fit->p_S, radius_m); !sound)
    return fail(sound.error().message);
  const Eigen::Matrix3d covariance = fit->covariance + calibration_covariance(depth, fit->p_S);
  return DepthTarget{{imager->name, fit->p_S, std::sqrt(covariance.trace() / 3)}, fit->readings};
}

}  // namespace wagonsight
