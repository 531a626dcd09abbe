#include "calibrate/ball_centre.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace wagonsight {
namespace {

struct Reading {
  Eigen::Vector3d ray;  // (x, y, 1)
  double z;             // corrected
  double sigma_z;
};

// All readings of a square window about a pixel.
std::vector<Reading> readings_about(const DepthImage& image, const ImagerSolution& imager,
                                    const Eigen::Vector2d& near, double half_px,
                                    const DepthNoise& noise) {
  const Camera camera = imager.measuring_camera();
  const double scale = imager.depth ? imager.depth->scale : 1;
  const double offset = imager.depth ? imager.depth->offset_m : 0;
  const auto clamp = [](double value, int size) {
    return static_cast<int>(std::clamp(std::round(value), 0.0, static_cast<double>(size - 1)));
  };
  std::vector<Reading> readings;
  for (int v = clamp(near.y() - half_px, image.height);
       v <= clamp(near.y() + half_px, image.height); ++v)
    for (int u = clamp(near.x() - half_px, image.width);
         u <= clamp(near.x() + half_px, image.width); ++u) {
      const double raw = 1e-3 * image.at(u, v);
      const auto ray = ray_through(camera, Eigen::Vector2d(u, v));
      if (raw <= 0 || !ray) continue;
      readings.push_back({*ray, scale * raw + offset,
                          std::hypot(noise.sigma(raw), noise.step(raw) / std::sqrt(12.0))});
    }
  return readings;
}

// Normal equations of the centre.
struct Normal {
  Eigen::Matrix3d N = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  double squares_m2 = 0, weighted = 0;
  int readings = 0;
};

Normal accumulate(const std::vector<Reading>& readings, const Eigen::Vector3d& centre,
                  double radius, double gate_sigmas) {
  constexpr double kGrazing = 0.4;  // cosine: beyond, a reading mixes ball and background
  Normal normal;
  for (const Reading& reading : readings) {
    const Eigen::Vector3d from_centre = reading.z * reading.ray - centre;
    const double distance = from_centre.norm();
    const Eigen::Vector3d out = from_centre / distance;
    const double along = out.dot(reading.ray);
    if (along > -kGrazing * reading.ray.norm()) continue;
    const double e = distance - radius, sigma = -along * reading.sigma_z;
    if (std::abs(e) > std::max(gate_sigmas * sigma, 0.1 * radius)) continue;
    const double weight = 1 / (sigma * sigma);
    normal.N += weight * out * out.transpose();
    normal.g += weight * e * out;
    normal.squares_m2 += e * e;
    normal.weighted += weight * e * e;
    ++normal.readings;
  }
  return normal;
}

// A ball stands out: of the readings just outside of its outline most lie behind its centre, or it
// is a piece of a wall, which far away is as round as its noise. A post or a hand may hold it.
bool stands_out(const std::vector<Reading>& readings, const Eigen::Vector3d& centre,
                double radius) {
  constexpr double kInner = 1.15, kOuter = 1.5;  // of the radius
  int around = 0, behind = 0;
  for (const Reading& reading : readings) {
    const Eigen::Vector3d unit = reading.ray.normalized();
    const double beside = (centre - centre.dot(unit) * unit).norm();
    if (beside < kInner * radius || beside > kOuter * radius) continue;
    ++around;
    if (reading.z > centre.z()) ++behind;
  }
  return 2 * behind >= around;  // no reading at all: the sky, a black wall, the ball's own shadow
}

}  // namespace

std::optional<BallCentre> ball_centre(const Camera& camera, const BallOutline& outline,
                                      std::optional<double> radius_m) {
  constexpr int kPoints = 48;
  Eigen::Matrix3d N = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  const Eigen::Vector2d long_axis(std::cos(outline.angle), std::sin(outline.angle));
  const Eigen::Vector2d short_axis(-long_axis.y(), long_axis.x());
  for (int i = 0; i < kPoints; ++i) {
    const double turn = 2 * std::numbers::pi * i / kPoints;
    const auto ray =
        ray_through(camera, outline.centre + outline.semi_axes_px[0] * std::cos(turn) * long_axis +
                                outline.semi_axes_px[1] * std::sin(turn) * short_axis);
    if (!ray) return std::nullopt;
    const Eigen::Vector3d unit = ray->normalized();
    N += unit * unit.transpose();
    g += unit;
  }
  const Eigen::Vector3d m = N.ldlt().solve(g);
  const auto pixel = project(camera, m);
  if (!m.allFinite() || !pixel) return std::nullopt;
  BallCentre result{*pixel, (*pixel - outline.centre).norm(), std::nullopt};
  // r m = 1 on the cone: the cosine of its half angle is 1 / |m|, its sine radius / distance.
  const double sine2 = 1 - 1 / m.squaredNorm();
  if (radius_m && sine2 > 0) result.distance_m = *radius_m / std::sqrt(sine2);
  return result;
}

Result<SphereFit> fit_sphere(const DepthImage& image, const ImagerSolution& imager,
                             const Eigen::Vector2d& near, double radius_m,
                             const DepthNoise& noise) {
  // The nearer readings about the click are the ball's, the farther ones what is behind it.
  constexpr double kFirstHalf_px = 4;
  std::vector<Reading> readings = readings_about(image, imager, near, kFirstHalf_px, noise);
  const std::string where =
      fmt::format("{}: the depth at ({:.0f}, {:.0f})", imager.name, near.x(), near.y());
  if (readings.empty())
    return fail(where +
                " has no reading; choose an image in which the ball is seen, or a matt ball");
  const auto quarter = readings.begin() + static_cast<std::ptrdiff_t>(readings.size() / 4);
  std::nth_element(readings.begin(), quarter, readings.end(),
                   [](const Reading& a, const Reading& b) { return a.z < b.z; });
  const double nearest = quarter->z;
  const auto ray = ray_through(imager.measuring_camera(), near);
  if (!ray) return fail(where + " lies where the lens is not invertible");
  Eigen::Vector3d centre = *ray * (nearest + radius_m);
  const double half_px = 1.5 * imager.measuring_camera().fx * radius_m / nearest + 2;
  readings = readings_about(image, imager, near, half_px, noise);
  constexpr int kRounds = 20;
  constexpr int kReadingsMin = 12;
  Normal normal;
  for (int round = 0; round < kRounds; ++round) {
    normal = accumulate(readings, centre, radius_m, round < 4 ? 8 : 4);
    if (normal.readings < kReadingsMin) break;
    const Eigen::Vector3d step = normal.N.ldlt().solve(normal.g);
    centre += step;
    if (round > 4 && step.norm() < 1e-7) break;
  }
  normal = accumulate(readings, centre, radius_m, 4);
  const double cap_readings =
      std::numbers::pi / 4 * std::pow(imager.measuring_camera().fx * radius_m / nearest, 2);
  if (normal.readings < kReadingsMin || normal.readings < 0.4 * cap_readings)
    return fail(fmt::format("{} is not that of a ball of {:.0f} mm radius ({} readings fit)", where,
                            radius_m * 1e3, normal.readings));
  if (!stands_out(readings, centre, radius_m))
    return fail(fmt::format(
        "{} is not that of a ball of {:.0f} mm radius (what is beside it lies no farther away)",
        where, radius_m * 1e3));
  SphereFit result;
  result.p_S = centre;
  result.readings = normal.readings;
  result.rms_m = std::sqrt(normal.squares_m2 / normal.readings);
  // Readings of one matching window are alike: as many are independent as windows (9 x 9) fit,
  // one at least.
  constexpr double kAlike = 81;
  const double alike = std::min(kAlike, static_cast<double>(normal.readings) / 3);
  const double widen = std::max(1.0, normal.weighted / normal.readings);
  result.covariance = alike * widen * normal.N.inverse();
  return result;
}

}  // namespace wagonsight
