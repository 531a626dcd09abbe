#include "foreground/sensor_view.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "foreground/mask_rays.h"

namespace wagonsight {
namespace {

// Raw readings are 16 bit; thresholds keep one value above the last for "never".
constexpr int kRawMax = 65'534;

}  // namespace

DepthModel::DepthModel(const RigSensor& sensor, double noise_sigmas) {
  const double scale = sensor.depth_scale * 0.001;
  WS_CHECK(scale > 0 && sensor.trim_far > sensor.trim_near, "scale %g, trim %g to %g", scale,
           sensor.trim_near, sensor.trim_far);
  z_offset_ = static_cast<float>(sensor.depth_offset);
  raw_per_m_ = static_cast<float>(1.0 / scale);
  const auto raw_of = [&](double z) {
    return std::clamp((z - sensor.depth_offset) / scale, 1.0, static_cast<double>(kRawMax));
  };
  trim_ = {static_cast<std::uint16_t>(std::ceil(raw_of(sensor.trim_near))),
           static_cast<std::uint16_t>(std::floor(raw_of(sensor.trim_far)))};
  const std::size_t count = std::size_t{trim_.last} + 1;
  z_.resize(count);
  sigma_.resize(count);
  tolerance_.resize(count);
  for (std::size_t raw = 0; raw < count; ++raw) {
    const double z = std::max(0.0, scale * static_cast<double>(raw) + sensor.depth_offset);
    z_[raw] = static_cast<float>(z);
    sigma_[raw] = static_cast<float>(sensor.noise.sigma(z));
    tolerance_[raw] = static_cast<float>(noise_sigmas * sensor.noise.sigma(z));
  }
  // One metre beyond the trim is farther than any tolerance reaches that still makes sense.
  const auto millimetres = static_cast<std::size_t>(std::ceil(sensor.trim_far * 1000)) + 1000;
  first_reaching_.resize(millimetres);
  last_reaching_.resize(millimetres);
  std::size_t first = 0, last = 0;
  for (std::size_t mm = 0; mm < millimetres; ++mm) {
    const float depth = static_cast<float>(mm) * 0.001F;
    while (first < count && z_[first] + tolerance_[first] < depth) ++first;
    while (last < count && z_[last] - tolerance_[last] <= depth) ++last;
    first_reaching_[mm] = static_cast<std::uint16_t>(std::max<std::size_t>(first, trim_.first));
    last_reaching_[mm] = static_cast<std::uint16_t>(last == 0 ? 0 : last - 1);
  }
}

RawInterval DepthModel::readings_of(float near_m, float far_m) const {
  const auto last_mm = static_cast<int>(first_reaching_.size()) - 1;
  const int near_mm = std::clamp(static_cast<int>(near_m * 1000.0F), 0, last_mm);
  const int far_mm = std::clamp(static_cast<int>(far_m * 1000.0F) + 1, 0, last_mm);
  return {first_reaching_[static_cast<std::size_t>(near_mm)],
          last_reaching_[static_cast<std::size_t>(far_mm)]};
}

std::uint16_t DepthModel::raw_at(float depth_m) const {
  return static_cast<std::uint16_t>(std::lower_bound(z_.begin(), z_.end(), depth_m) - z_.begin());
}

SensorView::SensorView(const RigSensor& sensor, RayTable rays, const Wagon& wagon,
                       const LeafGrid& grid, double noise_sigmas)
    : width_(sensor.camera.width),
      height_(sensor.camera.height),
      rays_(rays),
      depth_(sensor, noise_sigmas),
      grid_(grid),
      origin_W_(sensor.X_WS.position.cast<float>()),
      leaves_per_m_(static_cast<float>(1.0 / grid.leaf_m())),
      fx_(static_cast<float>(sensor.camera.fx)),
      fy_(static_cast<float>(sensor.camera.fy)),
      cx_(static_cast<float>(sensor.camera.cx)),
      cy_(static_cast<float>(sensor.camera.cy)),
      has_distortion_(sensor.camera.has_distortion()),
      inside_min_(wagon.inside.min.cast<float>()),
      inside_max_(wagon.inside.max.cast<float>()) {
  WS_CHECK(rays.size() == static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_),
           "%zu rays for %d x %d pixels", rays.size(), width_, height_);
  const Eigen::Matrix3f R_WS = sensor.X_WS.rotation.toRotationMatrix().cast<float>();
  columns_W_[0] = R_WS.col(0) * kRayScale;
  columns_W_[1] = R_WS.col(1) * kRayScale;
  columns_W_[2] = R_WS.col(2);
  origin_grid_ = ((sensor.X_WS.position - grid.min()) / grid.leaf_m()).cast<float>();
  R_SW_ = R_WS.transpose();
  t_SW_ = -(R_SW_ * origin_W_);
  focal_ = std::max(fx_, fy_);
  pixel_area_ = 1.0F / (fx_ * fy_);
  std::transform(sensor.camera.distortion.begin(), sensor.camera.distortion.end(), distortion_,
                 [](double k) { return static_cast<float>(k); });
  for (const MaskVolume& mask : wagon.masks) {
    masks_.push_back({mask.bounds.min.cast<float>(), mask.bounds.max.cast<float>()});
  }
  maskable_ = rays_into_masks(sensor, rays, wagon);
}

LeafAddress SensorView::leaf_of(std::size_t pixel, std::uint16_t raw) const {
  const float z = depth_.z(raw);
  if ((maskable_[pixel / 64] >> (pixel % 64) & 1) != 0 && masked(point_W(pixel, z))) return kNoLeaf;
  const Eigen::Vector3f at = origin_grid_ + z * ray_grid(pixel);
  // Before the corner, truncation would round into the grid.
  if (!(at.minCoeff() >= 0)) return kNoLeaf;
  const LeafIndex leaf{static_cast<int>(at.x()), static_cast<int>(at.y()),
                       static_cast<int>(at.z())};
  return grid_.contains(leaf) ? grid_.address(leaf) : kNoLeaf;
}

// The sums are in the order of point_W(), so that both give the same bits; a plain loop without
// aliases, which the compiler turns into several pixels at a time.
void SensorView::points_W(std::span<const PixelRay> rays, std::span<const float> z, float* x_W,
                          float* y_W, float* z_W) const {
  const Eigen::Vector3f across = columns_W_[0], down = columns_W_[1], along = columns_W_[2];
  const Eigen::Vector3f origin = origin_W_;
  const PixelRay* __restrict const ray = rays.data();
  const float* __restrict const depth = z.data();
  float* __restrict const x = x_W, * __restrict const y = y_W, * __restrict const up = z_W;
  for (std::size_t i = 0; i < z.size(); ++i) {
    const auto u = static_cast<float>(ray[i].x), v = static_cast<float>(ray[i].y);
    x[i] = origin.x() + depth[i] * (across.x() * u + down.x() * v + along.x());
    y[i] = origin.y() + depth[i] * (across.y() * u + down.y() * v + along.y());
    up[i] = origin.z() + depth[i] * (across.z() * u + down.z() * v + along.z());
  }
}

std::optional<SensorView::Position> SensorView::project_anywhere(const Eigen::Vector3f& p_W) const {
  const Eigen::Vector3f p = R_SW_ * p_W + t_SW_;
  if (p.z() < 0.05F) return std::nullopt;
  float x = p.x() / p.z(), y = p.y() / p.z();
  if (has_distortion_) {
    // Brown's model as in geometry/camera.h, in single precision: a fifth of a pixel is plenty
    // here.
    const float r2 = x * x + y * y;
    if (r2 > 4.0F) return std::nullopt;  // far outside any image; the polynomial is meaningless
    const float radial = 1.0F + r2 * (distortion_[0] + r2 * (distortion_[1] + r2 * distortion_[4]));
    const float xy2 = 2.0F * x * y;
    const float x_distorted =
        x * radial + distortion_[2] * xy2 + distortion_[3] * (r2 + 2.0F * x * x);
    y = y * radial + distortion_[2] * (r2 + 2.0F * y * y) + distortion_[3] * xy2;
    x = x_distorted;
  }
  return Position{fx_ * x + cx_, fy_ * y + cy_, p.z()};
}

std::optional<SensorView::Pixel> SensorView::project(const Eigen::Vector3f& p_W) const {
  const auto position = project_anywhere(p_W);
  if (!position) return std::nullopt;
  const float u = position->u + 0.5F, v = position->v + 0.5F;
  if (!(u >= 0 && v >= 0 && u < static_cast<float>(width_) && v < static_cast<float>(height_))) {
    return std::nullopt;
  }
  return Pixel{static_cast<int>(u), static_cast<int>(v), position->z};
}

SensorView::Span SensorView::span_inside(std::size_t pixel) const {
  constexpr Span kNowhere{1, 0};
  if (!has_ray(pixel)) return kNowhere;
  const Eigen::Vector3f ray = ray_W(pixel);
  Span span{0, depth_.z(depth_.raw_far())};
  for (int axis = 0; axis < 3; ++axis) {
    float a = (inside_min_[axis] - origin_W_[axis]) / ray[axis];
    float b = (inside_max_[axis] - origin_W_[axis]) / ray[axis];
    if (std::abs(ray[axis]) < 1e-9F) {
      if (origin_W_[axis] < inside_min_[axis] || origin_W_[axis] > inside_max_[axis])
        return kNowhere;
      continue;
    }
    if (a > b) std::swap(a, b);
    span = {std::max(span.enter, a), std::min(span.leave, b)};
  }
  return span;
}

RawInterval SensorView::inside(std::size_t pixel) const {
  const Span span = span_inside(pixel);
  if (span.leave < span.enter) return {};
  const int last = static_cast<int>(depth_.raw_at(span.leave)) - 1;
  return {std::max(depth_.raw_near(), depth_.raw_at(span.enter)),
          static_cast<std::uint16_t>(std::clamp(last, 0, static_cast<int>(depth_.raw_far())))};
}

bool SensorView::is_inside(std::size_t pixel, std::uint16_t raw) const {
  if (raw < depth_.raw_near() || raw > depth_.raw_far()) return false;
  const Span span = span_inside(pixel);
  const float z = depth_.z(raw);
  return span.leave >= span.enter && z >= span.enter && z < span.leave;
}

bool SensorView::masked(const Eigen::Vector3f& p_W) const {
  return std::any_of(masks_.begin(), masks_.end(), [&](const MaskBox& box) {
    return (p_W.array() >= box.min.array()).all() && (p_W.array() <= box.max.array()).all();
  });
}

}  // namespace wagonsight
