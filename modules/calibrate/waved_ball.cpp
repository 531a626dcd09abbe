#include "calibrate/waved_ball.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace wagonsight {
namespace {

using Eigen::Vector3d;

// The near intersection of a ray (x, y, 1) and a sphere as a depth; nothing when it misses.
std::optional<double> depth_of_sphere(const Vector3d& ray, const Vector3d& centre, double radius) {
  const double a = ray.squaredNorm(), b = ray.dot(centre);
  const double root = b * b - a * (centre.squaredNorm() - radius * radius);
  if (root <= 0) return std::nullopt;
  return (b - std::sqrt(root)) / a;
}

// How far a ray passes by a point.
double distance_to_ray(const Vector3d& ray, const Vector3d& p) {
  return ray.cross(p).norm() / ray.norm();
}

}  // namespace

WavedBall::WavedBall(const RigSensor& sensor, RayTable rays, double radius_m)
    : sensor_(sensor), rays_(rays), radius_m_(radius_m), still_(rays.size()), front_(rays.size()) {
  WS_CHECK(rays.size() == static_cast<std::size_t>(sensor.camera.width) *
                              static_cast<std::size_t>(sensor.camera.height),
           "%zu rays", rays.size());
}

void WavedBall::learn(const DepthImage& image) {
  const auto pixels = image.span();
  seen_.emplace_back(pixels.begin(), pixels.end());
}

void WavedBall::finish_learning() {
  std::vector<std::uint16_t> values;
  for (std::size_t pixel = 0; pixel < still_.size(); ++pixel) {
    values.clear();
    for (const auto& image : seen_)
      if (image[pixel] != 0) values.push_back(image[pixel]);
    still_[pixel] = 0;
    if (values.size() < std::max<std::size_t>(2, seen_.size() / 3)) continue;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    still_[pixel] = *middle;
  }
  seen_.clear();
}

Vector3d WavedBall::ray(std::size_t pixel) const {
  return {static_cast<double>(rays_[pixel].x) * static_cast<double>(kRayScale),
          static_cast<double>(rays_[pixel].y) * static_cast<double>(kRayScale), 1};
}

// Of a reading on the sphere; three sigmas and what edges and rounding add.
double WavedBall::tolerance(double z) const {
  constexpr double kLeast_m = 0.015;
  return kLeast_m + 3 * sensor_.noise.sigma(z);
}

void WavedBall::take_foreground(const DepthImage& image) {
  constexpr double kBefore_m = 0.04;
  const auto metres = [&](std::uint16_t raw) {
    return sensor_.depth_scale * 1e-3 * raw + sensor_.depth_offset;
  };
  for (std::size_t pixel = 0; pixel < front_.size(); ++pixel) {
    front_[pixel] = 0;
    const std::uint16_t raw = image.pixels[pixel];
    if (raw == 0 || rays_[pixel].x == kNoRay) continue;
    const double z = metres(raw);
    if (z < sensor_.trim_near || z > sensor_.trim_far) continue;
    const bool stands_out =
        still_[pixel] == 0 || z < metres(still_[pixel]) - kBefore_m - tolerance(z);
    if (stands_out) front_[pixel] = static_cast<float>(z);
  }
}

// Visits pixels within `reach` metres about the centre's projection, about `steps` to either side.
template <class Visit>
void WavedBall::for_disc(const Vector3d& centre, double reach, int steps,
                         const Visit& visit) const {
  const Camera& camera = sensor_.camera;
  const auto middle = project(camera, centre);
  if (!middle) return;
  const double reach_px = std::max(camera.fx, camera.fy) * reach / centre.z();
  const int step = std::max(1, static_cast<int>(reach_px / steps));
  const int u0 = static_cast<int>(std::floor(middle->x() - reach_px)),
            u1 = static_cast<int>(std::ceil(middle->x() + reach_px));
  const int v0 = static_cast<int>(std::floor(middle->y() - reach_px)),
            v1 = static_cast<int>(std::ceil(middle->y() + reach_px));
  for (int v = std::max(0, v0); v <= std::min(v1, camera.height - 1); v += step)
    for (int u = std::max(0, u0); u <= std::min(u1, camera.width - 1); u += step)
      visit(static_cast<std::size_t>(v) * static_cast<std::size_t>(camera.width) +
            static_cast<std::size_t>(u));
}

WavedBall::Score WavedBall::score(const Vector3d& centre) const {
  constexpr int kSteps = 10;
  constexpr double kDisc = 0.85, kRingBegin = 1.2, kRingEnd = 1.6;  // radii
  int disc = 0, hits = 0, ring = 0, beside = 0;
  for_disc(centre, kRingEnd * radius_m_, kSteps, [&](std::size_t pixel) {
    const Vector3d direction = ray(pixel);
    const double off = distance_to_ray(direction, centre) / radius_m_;
    const auto z = static_cast<double>(front_[pixel]);
    if (off < kDisc) {
      ++disc;
      const auto expected = depth_of_sphere(direction, centre, radius_m_);
      hits += z > 0 && expected && std::abs(z - *expected) < tolerance(z) ? 1 : 0;
    } else if (off > kRingBegin && off < kRingEnd) {
      ++ring;
      beside += z > 0 && std::abs(z - centre.z()) < 2 * radius_m_ ? 1 : 0;
    }
  });
  // A disc of fewer pixels is no ball that could be measured.
  constexpr int kDiscPixelsMin = 20;
  if (disc < kDiscPixelsMin || ring == 0) return {};
  return {static_cast<double>(hits) / disc, static_cast<double>(beside) / ring};
}

// The limb of the ball is left out: there the depth says more of the pixel than of the ball.
std::vector<WavedBall::Reading> WavedBall::readings_on(const Vector3d& centre) const {
  constexpr int kEveryPixel = 1000;
  constexpr double kCap = 0.88;  // radii
  std::vector<Reading> readings;
  for_disc(centre, radius_m_, kEveryPixel, [&](std::size_t pixel) {
    const auto z = static_cast<double>(front_[pixel]);
    if (z <= 0) return;
    const Vector3d direction = ray(pixel);
    if (distance_to_ray(direction, centre) > kCap * radius_m_) return;
    const auto expected = depth_of_sphere(direction, centre, radius_m_);
    if (expected && std::abs(z - *expected) < tolerance(z)) readings.push_back({direction, z});
  });
  return readings;
}

// Gauss-Newton on the depth along each ray: there the noise is.
bool WavedBall::refine(Vector3d& centre, int& readings) const {
  constexpr int kRounds = 6, kReadingsMin = 30;
  for (int round = 0; round < kRounds; ++round) {
    const std::vector<Reading> cap = readings_on(centre);
    readings = static_cast<int>(cap.size());
    if (readings < kReadingsMin) return false;
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Vector3d right = Vector3d::Zero();
    for (const Reading& reading : cap) {
      const double expected = *depth_of_sphere(reading.ray, centre, radius_m_);
      // |z ray - c| = r, differentiated: dz/dc = n / (n . ray) with the surface's normal n.
      const Vector3d n = expected * reading.ray - centre;
      const Vector3d J = n / n.dot(reading.ray);
      normal += J * J.transpose();
      right += J * (reading.z - expected);
    }
    const Vector3d step = normal.ldlt().solve(right);
    if (!step.allFinite() || step.norm() > radius_m_) return false;
    centre += step;
    if (step.norm() < 1e-5) break;
  }
  return true;
}

std::optional<BallSighting> WavedBall::find(const DepthImage& image) {
  WS_CHECK(image.pixel_count() == front_.size(), "%zu pixels", image.pixel_count());
  take_foreground(image);
  constexpr int kEvery = 4;  // pixels; the refinement reaches further
  constexpr double kShareMin = 0.6, kBesideMax = 0.5;
  const int width = sensor_.camera.width, height = sensor_.camera.height;
  double best = 0;
  std::optional<Vector3d> found;
  for (int v = kEvery; v < height; v += kEvery)
    for (int u = kEvery; u < width; u += kEvery) {
      const auto pixel = static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                         static_cast<std::size_t>(u);
      if (front_[pixel] <= 0) continue;
      // As if this were the point of the ball that is nearest to the sensor.
      const Vector3d p_S = static_cast<double>(front_[pixel]) * ray(pixel);
      const Vector3d centre = p_S * (1 + radius_m_ / p_S.norm());
      const Score one = score(centre);
      if (one.share < kShareMin / 2 || one.share - one.beside <= best) continue;
      best = one.share - one.beside;
      found = centre;
    }
  if (!found) return std::nullopt;
  BallSighting sighting;
  if (!refine(*found, sighting.readings)) return std::nullopt;
  const Score fitted = score(*found);
  if (fitted.share < kShareMin || fitted.beside > kBesideMax) return std::nullopt;
  sighting.p_S = *found;
  return sighting;
}

}  // namespace wagonsight
