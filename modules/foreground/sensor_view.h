#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "frame/image.h"
#include "rig/ray_table.h"
#include "rig/rig.h"
#include "voxel/leaf_grid.h"
#include "wagon/wagon.h"

namespace wagonsight {

// Raw readings first..last, inclusive; empty when first > last.
struct RawInterval {
  std::uint16_t first = 1;
  std::uint16_t last = 0;
};

// What one sensor's raw reading means: metres, noise, and the readings that noise cannot tell from
// a surface. Tables over raw units, so that the per-pixel work is integer compares.
class DepthModel {
 public:
  DepthModel(const RigSensor& sensor, double noise_sigmas);

  // Trimmed readings: anything outside is dropped.
  std::uint16_t raw_near() const { return trim_.first; }
  std::uint16_t raw_far() const { return trim_.last; }
  // Metres along the optical axis; valid up to raw_far().
  float z(std::uint16_t raw) const { return z_[raw]; }
  // Beyond this depth nothing can be told from the farthest reading.
  float z_max() const { return z_[trim_.last] + tolerance_[trim_.last] + 0.01F; }
  // noise_sigmas standard deviations of a reading, metres; valid up to raw_far().
  float tolerance(std::uint16_t raw) const { return tolerance_[raw]; }
  float sigma(std::uint16_t raw) const { return sigma_[raw]; }
  // Readings (within the trim) from which noise alone could reach something that spans the depths
  // near_m..far_m: z + tolerance >= near_m and z - tolerance <= far_m, on a millimetre's grid.
  RawInterval readings_of(float near_m, float far_m) const;
  // The same for a depth, by its nearest reading.
  float sigma_at(float depth_m) const {
    const float raw = (depth_m - z_offset_) * raw_per_m_;
    return sigma_[raw < 0 ? 0 : std::min(static_cast<std::size_t>(raw + 0.5F), sigma_.size() - 1)];
  }
  // The smallest reading at or beyond a depth, raw_far() + 1 when there is none.
  std::uint16_t raw_at(float depth_m) const;

 private:
  RawInterval trim_;
  float z_offset_ = 0, raw_per_m_ = 0;
  std::vector<float> z_, sigma_, tolerance_;
  std::vector<std::uint16_t> first_reaching_;  // by millimetre
  std::vector<std::uint16_t> last_reaching_;
};

// One sensor in its room: where each pixel's ray goes in the world and in the octree's grid.
class SensorView {
 public:
  // `rays` and nothing else is kept by reference. `grid` covers the wagon's inside.
  SensorView(const RigSensor& sensor, RayTable rays, const Wagon& wagon, const LeafGrid& grid,
             double noise_sigmas);

  int width() const { return width_; }
  int height() const { return height_; }
  std::size_t pixel_count() const { return rays_.size(); }
  const DepthModel& depth() const { return depth_; }
  const LeafGrid& grid() const { return grid_; }
  bool has_ray(std::size_t pixel) const { return rays_[pixel].x != kNoRay; }

  // The direction of a pixel's ray in W: a metre of depth, not a unit vector.
  Eigen::Vector3f ray_W(std::size_t pixel) const {
    const PixelRay ray = rays_[pixel];
    return columns_W_[0] * static_cast<float>(ray.x) + columns_W_[1] * static_cast<float>(ray.y) +
           columns_W_[2];
  }
  const Eigen::Vector3f& origin_W() const { return origin_W_; }
  Eigen::Vector3f point_W(std::size_t pixel, float z) const { return origin_W_ + z * ray_W(pixel); }
  // point_W() of pixels anywhere in the image, by their rays and depths; as many as there are
  // depths.
  void points_W(std::span<const PixelRay> rays, std::span<const float> z, float* x_W, float* y_W,
                float* z_W) const;
  PixelRay ray(std::size_t pixel) const { return rays_[pixel]; }
  // In leaves from the grid's corner.
  Eigen::Vector3f ray_grid(std::size_t pixel) const { return ray_W(pixel) * leaves_per_m_; }
  const Eigen::Vector3f& origin_grid() const { return origin_grid_; }
  // The leaf a reading falls into, kNoLeaf outside of the grid or inside a mask volume.
  LeafAddress leaf_of(std::size_t pixel, std::uint16_t raw) const;

  // Where a point of W is seen: pixel coordinates and depth; nothing behind or outside the image.
  struct Pixel {
    int u, v;
    float z;
  };
  std::optional<Pixel> project(const Eigen::Vector3f& p_W) const;
  // The same without the image's borders, in fractions of a pixel; nothing behind the sensor.
  struct Position {
    float u, v, z;
  };
  std::optional<Position> project_anywhere(const Eigen::Vector3f& p_W) const;
  // Depth of a point of W along the optical axis.
  float depth_of(const Eigen::Vector3f& p_W) const { return R_SW_.row(2).dot(p_W) + t_SW_.z(); }
  // Pixels a metre at one metre's depth.
  float focal() const { return focal_; }

  // The readings of a pixel that lie inside the wagon and the trim.
  RawInterval inside(std::size_t pixel) const;
  // Whether a reading (up to raw_far()) is one of them, without looking for where they begin.
  bool is_inside(std::size_t pixel, std::uint16_t raw) const;
  bool has_masks() const { return !masks_.empty(); }
  // Of 64 pixels those whose ray comes to a mask volume; no reading of others is masked.
  std::uint64_t maskable(std::size_t word) const { return maskable_[word]; }
  bool masked(const Eigen::Vector3f& p_W) const;
  // Square metres that one pixel covers at one metre.
  float pixel_area() const { return pixel_area_; }

 private:
  struct Span {
    float enter, leave;
  };
  // Where a pixel's ray is inside the wagon, along the optical axis, up to the farthest reading;
  // leave < enter: nowhere.
  Span span_inside(std::size_t pixel) const;

  int width_, height_;
  RayTable rays_;
  DepthModel depth_;
  LeafGrid grid_;
  Eigen::Vector3f columns_W_[3];
  Eigen::Vector3f origin_W_;
  Eigen::Vector3f origin_grid_;
  float leaves_per_m_;
  float focal_, pixel_area_;
  float fx_, fy_, cx_, cy_;
  float distortion_[5];
  bool has_distortion_;
  Eigen::Matrix3f R_SW_;
  Eigen::Vector3f t_SW_;
  Eigen::Vector3f inside_min_, inside_max_;
  struct MaskBox {
    Eigen::Vector3f min, max;
  };
  std::vector<MaskBox> masks_;
  std::vector<std::uint64_t> maskable_;  // a bit a pixel
};

}  // namespace wagonsight
