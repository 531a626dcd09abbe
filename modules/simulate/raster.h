#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "geometry/camera.h"
#include "geometry/transform.h"
#include "simulate/part.h"

namespace wagonsight {

// A rectangle of pixels, end exclusive; empty when u_end <= u or v_end <= v.
struct DrawRect {
  int u = 0, v = 0, u_end = 0, v_end = 0;

  bool empty() const { return u_end <= u || v_end <= v; }
};

// A Part prepared for one camera: rays are d = (x, y, 1) and a point is d / w, so w is the inverse
// of the depth z. m are the three local axes divided by the half sizes, in S; c = m * centre.
struct PreparedPart {
  Part::Shape shape = Part::Shape::kEllipsoid;
  std::array<std::array<float, 3>, 3> m{};
  std::array<float, 3> c{};
  float taper = 0;
  float albedo = 0;
  std::int32_t tag = 0;
  DrawRect rect;
};

// What a pixel sees: inverse depth (1/m; 0: nothing) and which part of the list (or -1).
struct RasterTarget {
  int width = 0, height = 0;
  std::span<float> inverse_depth;
  std::span<std::int32_t> part;
};

// Casts parts into an image without distortion, analytically and row by row: for a quadric
// A t^2 + 2 B t + C = 0 along the ray, w = 1/t = (sqrt(B^2 - A C) - B) / C, where C > 0 because
// the camera is outside. No allocation, no division in the inner loop.
class Raster {
 public:
  explicit Raster(const Camera& camera);

  // The part as seen with the pose X_SW; its rect is empty when it is out of view.
  PreparedPart prepare(const Part& part_W, const Rigid& X_SW) const;

  // Draws `part` where it is nearer than what stands there, with `index` as its mark.
  void draw(const PreparedPart& part, std::int32_t index, const RasterTarget& target) const;

  // Cosine between the ray through (u, v) and the surface of `part` where it was hit at w.
  float incidence(const PreparedPart& part, int u, int v, float w) const;

  float ray_x(int u) const { return ray_x_[static_cast<std::size_t>(u)]; }
  float ray_y(int v) const { return ray_y_[static_cast<std::size_t>(v)]; }
  const Camera& camera() const { return camera_; }

 private:
  DrawRect bounds(const Part& part_S) const;

  Camera camera_;
  std::vector<float> ray_x_, ray_y_;  // by column and by row
};

inline float Raster::incidence(const PreparedPart& part, int u, int v, float w) const {
  const float x = ray_x(u), y = ray_y(v), t = 1.0F / w;
  std::array<float, 3> local{};
  for (std::size_t i = 0; i < 3; ++i)
    local[i] = (part.m[i][0] * x + part.m[i][1] * y + part.m[i][2]) * t - part.c[i];
  if (part.shape == Part::Shape::kCone) {
    local[2] = -part.taper * (1.0F + part.taper * local[2]);
  } else if (part.shape == Part::Shape::kBox) {
    std::size_t face = 0;
    for (std::size_t i = 1; i < 3; ++i)
      if (std::abs(local[i]) > std::abs(local[face])) face = i;
    for (std::size_t i = 0; i < 3; ++i) local[i] = i == face ? local[i] : 0.0F;
  }
  // The gradient of the implicit function, from local coordinates back to S.
  std::array<float, 3> n{};
  for (std::size_t k = 0; k < 3; ++k)
    n[k] = local[0] * part.m[0][k] + local[1] * part.m[1][k] + local[2] * part.m[2][k];
  const float dot = n[0] * x + n[1] * y + n[2];
  const float norm2 = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
  return std::min(std::abs(dot) / std::sqrt(norm2 * (x * x + y * y + 1.0F) + 1e-20F), 1.0F);
}

}  // namespace wagonsight
