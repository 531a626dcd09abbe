#include "fusion/fused_cloud.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

// Twice the points, a power of two: open addressing stays below half full.
constexpr std::uint32_t kTableSize = 2 * kFusedPointsMax;
static_assert((kTableSize & (kTableSize - 1)) == 0);
constexpr std::uint32_t kNoPoint = UINT32_MAX;

// Teschner et al. 2003, "Optimized spatial hashing", of blocks of 4 x 4 x 4 voxels; a block's
// voxels lie side by side, because the next point is mostly in the same block and the table is
// larger than a processor's nearer caches.
std::uint32_t hash_of(std::int32_t x, std::int32_t y, std::int32_t z) {
  std::uint32_t h = (static_cast<std::uint32_t>(x >> 2) * 73856093U) ^
                    (static_cast<std::uint32_t>(y >> 2) * 19349663U) ^
                    (static_cast<std::uint32_t>(z >> 2) * 83492791U);
  h ^= h >> 15;
  const auto place = static_cast<std::uint32_t>((x & 3) | (y & 3) << 2 | (z & 3) << 4);
  return (h << 6 | place) & (kTableSize - 1);
}

// std::floor() of what fits an integer, which is a call without SSE 4.1.
std::int32_t floor_to_int(float value) {
  const auto whole = static_cast<std::int32_t>(value);
  return whole - (static_cast<float>(whole) > value ? 1 : 0);
}

// The hint whose circle holds the place; the nearest when several do.
const MotionHint* hint_at(std::span<const MotionHint> hints, float x, float y) {
  const MotionHint* best = nullptr;
  float best_distance2 = 0;
  for (const MotionHint& hint : hints) {
    const float dx = x - hint.x;
    const float dy = y - hint.y;
    const float distance2 = dx * dx + dy * dy;
    if (distance2 > hint.radius * hint.radius) continue;
    if (best == nullptr || distance2 < best_distance2) {
      best = &hint;
      best_distance2 = distance2;
    }
  }
  return best;
}

}  // namespace

Fusion::Fusion(const Rig& rig, double voxel_m)
    : voxels_per_metre_(static_cast<float>(1.0 / voxel_m)),
      table_(make_fresh_array<Cell>(kTableSize)) {
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) {
    const RigSensor& sensor = rig.sensors[i];
    SensorModel& model = sensors_[i];
    const Eigen::Matrix3f R_SW = sensor.X_WS.rotation.conjugate().toRotationMatrix().cast<float>();
    for (int row = 0; row < 3; ++row)
      for (int col = 0; col < 3; ++col)
        model.rotation_SW[3 * static_cast<std::size_t>(row) + static_cast<std::size_t>(col)] =
            R_SW(row, col);
    for (int axis = 0; axis < 3; ++axis)
      model.position_W[static_cast<std::size_t>(axis)] =
          static_cast<float>(sensor.X_WS.position[axis]);
    model.fx = static_cast<float>(sensor.camera.fx);
    model.fy = static_cast<float>(sensor.camera.fy);
    model.cx = static_cast<float>(sensor.camera.cx);
    model.cy = static_cast<float>(sensor.camera.cy);
    model.width = sensor.camera.width;
    model.height = sensor.camera.height;
    // A Kinect leaves up to 8 of 640 columns without depth on its right.
    model.margin = 0.02F * static_cast<float>(sensor.camera.width);
  }
}

const FusedCloud& Fusion::fuse(std::span<const ForegroundView> views,
                               std::span<const MotionHint> hints) {
  cloud_.points.clear();
  cloud_.contributions.clear();
  cloud_.dropped = 0;
  ++generation_;
  for (std::size_t i = 0; i < views.size() && i < kSensorsMax; ++i)
    if (views[i].foreground != nullptr) add_view(i, views[i], hints);

  // The sums of several sensors become means.
  for (FusedPoint& point : cloud_.points) {
    const float length = std::hypot(point.away_x, point.away_y);
    if (length > 1.0F) {
      point.away_x /= length;
      point.away_y /= length;
    }
  }
  return cloud_;
}

void Fusion::add_view(std::size_t sensor_index, const ForegroundView& view,
                      std::span<const MotionHint> hints) {
  const SensorModel& sensor = sensors_[sensor_index];
  const auto skew_s = static_cast<float>(to_seconds(view.skew));
  for (const ForegroundPoint& from : view.foreground->points) {
    const float dx = from.x - sensor.position_W[0];
    const float dy = from.y - sensor.position_W[1];
    const float dz = from.z - sensor.position_W[2];
    const auto& R = sensor.rotation_SW;
    const float depth = R[6] * dx + R[7] * dy + R[8] * dz;
    if (!(depth > 0)) continue;
    const float u = sensor.fx * (R[0] * dx + R[1] * dy + R[2] * dz) / depth + sensor.cx;
    const float v = sensor.fy * (R[3] * dx + R[4] * dy + R[5] * dz) / depth + sensor.cy;

    float x = from.x;
    float y = from.y;
    if (skew_s != 0.0F) {
      if (const MotionHint* hint = hint_at(hints, x, y)) {
        x -= hint->vx * skew_s;
        y -= hint->vy * skew_s;
      }
    }

    bool is_new = false;
    const std::uint32_t index = point_at(x, y, from.z, is_new);
    if (index == kNoPoint || cloud_.contributions.full()) {
      ++cloud_.dropped;
      continue;
    }
    FusedPoint& point = cloud_.points[index];
    const float range = std::sqrt(dx * dx + dy * dy + dz * dz);
    const float area = static_cast<float>(from.pixels) * depth * depth / (sensor.fx * sensor.fy);
    if (is_new) {
      point = {x,          y,          from.z, from.sigma, area,
               dx / range, dy / range, 0,      from.blob,  static_cast<std::uint8_t>(sensor_index)};
    } else {
      // The more certain reading weighs more (inverse variance of two readings).
      const float w = point.sigma * point.sigma /
                      std::max(point.sigma * point.sigma + from.sigma * from.sigma, 1e-12F);
      point.x += w * (x - point.x);
      point.y += w * (y - point.y);
      point.z += w * (from.z - point.z);
      point.sigma = std::min(point.sigma, from.sigma);
      point.area_m2 = std::max(point.area_m2, area);
      point.away_x = 0.5F * (point.away_x + dx / range);
      point.away_y = 0.5F * (point.away_y + dy / range);
    }
    point.sensors = static_cast<std::uint16_t>(point.sensors | (1U << sensor_index));
    const auto to_pixel = [](float value, int size) {
      return static_cast<std::uint16_t>(
          std::clamp(value + 0.5F, 0.0F, static_cast<float>(size - 1)));
    };
    const auto borders = static_cast<std::uint8_t>(
        (u < sensor.margin ? kLeft : 0) |
        (u > static_cast<float>(sensor.width - 1) - sensor.margin ? kRight : 0) |
        (v < sensor.margin ? kTop : 0) |
        (v > static_cast<float>(sensor.height - 1) - sensor.margin ? kBottom : 0));
    cloud_.contributions.resize(cloud_.contributions.size() + 1);
    cloud_.contributions[cloud_.contributions.size() - 1] = {
        index,
        depth,
        from.pixels,
        to_pixel(u, sensor.width),
        to_pixel(v, sensor.height),
        static_cast<std::uint8_t>(sensor_index),
        borders};
  }
}

std::uint32_t Fusion::point_at(float x, float y, float z, bool& is_new) {
  static_assert(kFusedPointsMax <= std::size_t{UINT16_MAX} + 1);
  const std::int32_t vx = floor_to_int(x * voxels_per_metre_);
  const std::int32_t vy = floor_to_int(y * voxels_per_metre_);
  const std::int32_t vz = floor_to_int(z * voxels_per_metre_);
  const auto low_x = static_cast<std::int16_t>(vx), low_y = static_cast<std::int16_t>(vy),
             low_z = static_cast<std::int16_t>(vz);
  for (std::uint32_t slot = hash_of(vx, vy, vz);; slot = (slot + 1) & (kTableSize - 1)) {
    Cell& cell = table_[slot];
    if (cell.stamp != generation_) {
      if (cloud_.points.full()) return kNoPoint;
      is_new = true;
      cell = {low_x, low_y, low_z, static_cast<std::uint16_t>(cloud_.points.size()), generation_};
      cloud_.points.resize(cloud_.points.size() + 1);
      return cell.point;
    }
    if (cell.x == low_x && cell.y == low_y && cell.z == low_z) return cell.point;
  }
}

}  // namespace wagonsight
