#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "geometry/camera.h"
#include "geometry/transform.h"
#include "simulate/part.h"

namespace wagonsight {

// A rectangle of pixels, end exclusive; empty when u_end <= u or v_end <= v.
struct PixelRect {
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
  PixelRect rect;
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
  PixelRect bounds(const Part& part_S) const;

  Camera camera_;
  std::vector<float> ray_x_, ray_y_;  // by column and by row
};

}  // namespace wagonsight
