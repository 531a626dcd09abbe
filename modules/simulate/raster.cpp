#include "simulate/raster.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

constexpr double kNearest = 0.05;  // metres: nothing nearer to a camera is drawn

// A linear form over one row: value = slope * x + start, with x the ray's first coordinate.
struct RowForm {
  float slope, start;
};

RowForm row_form(const std::array<float, 3>& m, float y) {
  return {m[0], m[1] * y + m[2]};
}

struct Row {  // the pixels of one row of one part
  const float* x;
  float* w;
  std::int32_t* mark;
  int count;

  void narrow(int begin, int end) {
    x += begin, w += begin, mark += begin;
    count = end - begin;
  }
};

// Keeps only the pixels in which the discriminant a x^2 + 2 b x + c of a quadric can be positive,
// one more on each side for the rounding.
void narrow(double a, double b, double c, double pixels_per_x, Row& row) {
  if (a >= 0 || row.count <= 0) return;  // seen from within a cone's opening: all of them
  const double inner = b * b - a * c;
  if (inner <= 0) {
    row.count = 0;
    return;
  }
  const double root = std::sqrt(inner), first = static_cast<double>(row.x[0]);
  const double low = ((-b + root) / a - first) * pixels_per_x - 1;
  const double high = ((-b - root) / a - first) * pixels_per_x + 2;
  const double count = row.count;
  row.narrow(static_cast<int>(std::clamp(low, 0.0, count)),
             static_cast<int>(std::clamp(high, 0.0, count)));
}

// The coefficients of the discriminant over a row from those of its three linear forms: with
// A = sum of weight_i a_i^2 and the half-linear term P x + Q it is (P x + Q)^2 - C A(x).
void narrow_quadric(const std::array<RowForm, 3>& forms, double last_weight, double P, double Q,
                    double C, double pixels_per_x, Row& row) {
  double alpha = 0, beta = 0, gamma = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const double weight = i == 2 ? last_weight : 1;
    const double slope = static_cast<double>(forms[i].slope);
    const double start = static_cast<double>(forms[i].start);
    alpha += weight * slope * slope;
    beta += weight * slope * start;
    gamma += weight * start * start;
  }
  narrow(P * P - C * alpha, P * Q - C * beta, Q * Q - C * gamma, pixels_per_x, row);
}

void draw_ellipsoid(const PreparedPart& part, float y, std::int32_t index, double pixels_per_x,
                    Row row) {
  const RowForm f0 = row_form(part.m[0], y), f1 = row_form(part.m[1], y),
                f2 = row_form(part.m[2], y);
  const float c0 = part.c[0], c1 = part.c[1], c2 = part.c[2];
  const float C = c0 * c0 + c1 * c1 + c2 * c2 - 1.0F;
  if (C <= 0) return;
  narrow_quadric({f0, f1, f2}, 1, f0.slope * c0 + f1.slope * c1 + f2.slope * c2,
                 f0.start * c0 + f1.start * c1 + f2.start * c2, C, pixels_per_x, row);
  const float C_inverse = 1.0F / C;
  for (int i = 0; i < row.count; ++i) {
    const float a0 = f0.slope * row.x[i] + f0.start;
    const float a1 = f1.slope * row.x[i] + f1.start;
    const float a2 = f2.slope * row.x[i] + f2.start;
    const float A = a0 * a0 + a1 * a1 + a2 * a2;
    const float minus_B = a0 * c0 + a1 * c1 + a2 * c2;
    const float discriminant = minus_B * minus_B - A * C;
    const float root = std::sqrt(std::max(discriminant, 0.0F));
    const float w = (root + minus_B) * C_inverse;
    const bool hit = (discriminant > 0) & (minus_B > 0) & (w > row.w[i]);
    row.w[i] = hit ? w : row.w[i];
    row.mark[i] = hit ? index : row.mark[i];
  }
}

void draw_cone(const PreparedPart& part, float y, std::int32_t index, double pixels_per_x,
               Row row) {
  const RowForm f0 = row_form(part.m[0], y), f1 = row_form(part.m[1], y),
                f2 = row_form(part.m[2], y);
  const float c0 = part.c[0], c1 = part.c[1], c2 = part.c[2];
  const float k = part.taper, g = 1.0F - k * c2;
  const float C = c0 * c0 + c1 * c1 - g * g;
  if (C <= 0) return;
  narrow_quadric({f0, f1, f2}, -k * k, f0.slope * c0 + f1.slope * c1 + k * f2.slope * g,
                 f0.start * c0 + f1.start * c1 + k * f2.start * g, C, pixels_per_x, row);
  const float C_inverse = 1.0F / C;
  for (int i = 0; i < row.count; ++i) {
    const float a0 = f0.slope * row.x[i] + f0.start;
    const float a1 = f1.slope * row.x[i] + f1.start;
    const float a2 = f2.slope * row.x[i] + f2.start;
    const float A = a0 * a0 + a1 * a1 - k * k * a2 * a2;
    const float minus_B = a0 * c0 + a1 * c1 + k * a2 * g;
    const float discriminant = minus_B * minus_B - A * C;
    const float root = std::sqrt(std::max(discriminant, 0.0F));
    const float w = (root + minus_B) * C_inverse;
    const bool within = std::abs(a2 - c2 * w) <= w;  // |l_2| <= 1: between the two ends
    const bool hit = (discriminant > 0) & within & (w > row.w[i]);
    row.w[i] = hit ? w : row.w[i];
    row.mark[i] = hit ? index : row.mark[i];
  }
}

// |a_i - c_i w| <= w for the three pairs of faces: bounds on w that are linear over the row.
void draw_box(const PreparedPart& part, float y, std::int32_t index, const Row& row) {
  std::array<RowForm, 6> upper{}, lower{};
  int upper_count = 0, lower_count = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const RowForm f = row_form(part.m[axis], y);
    for (const float side : {-1.0F, 1.0F}) {
      // side = -1: (c - 1) w <= a; side = 1: (c + 1) w >= a.
      float distance = part.c[axis] + side;
      if (std::abs(distance) < 1e-6F) distance = 1e-6F;
      const RowForm bound{f.slope / distance, f.start / distance};
      const bool is_upper = (side < 0) == (distance > 0);
      if (is_upper) {
        upper[static_cast<std::size_t>(upper_count++)] = bound;
      } else {
        lower[static_cast<std::size_t>(lower_count++)] = bound;
      }
    }
  }
  if (upper_count == 0) return;  // the camera is inside the box
  for (int i = upper_count; i < 3; ++i) upper[static_cast<std::size_t>(i)] = upper[0];
  for (int i = lower_count; i < 6; ++i) lower[static_cast<std::size_t>(i)] = lower[0];
  for (int i = 0; i < row.count; ++i) {
    const float x = row.x[i];
    const auto at = [x](const RowForm& form) { return form.slope * x + form.start; };
    const float w = std::min(std::min(at(upper[0]), at(upper[1])), at(upper[2]));
    const float w_low = std::max(std::max(std::max(at(lower[0]), at(lower[1])), at(lower[2])),
                                 std::max(std::max(at(lower[3]), at(lower[4])), at(lower[5])));
    const bool hit = (w >= w_low) & (w > row.w[i]);
    row.w[i] = hit ? w : row.w[i];
    row.mark[i] = hit ? index : row.mark[i];
  }
}

}  // namespace

Raster::Raster(const Camera& camera)
    : camera_(camera),
      ray_x_(static_cast<std::size_t>(camera.width)),
      ray_y_(static_cast<std::size_t>(camera.height)) {
  for (std::size_t u = 0; u < ray_x_.size(); ++u)
    ray_x_[u] = static_cast<float>((static_cast<double>(u) - camera.cx) / camera.fx);
  for (std::size_t v = 0; v < ray_y_.size(); ++v)
    ray_y_[v] = static_cast<float>((static_cast<double>(v) - camera.cy) / camera.fy);
}

// The hull of the projected corners of the part's own box holds the part's whole silhouette.
DrawRect Raster::bounds(const Part& part_S) const {
  Eigen::Vector3d half = part_S.half;
  if (part_S.shape == Part::Shape::kCone) half.head<2>() *= 1 + std::abs(part_S.taper);
  double u_min = 1e9, u_max = -1e9, v_min = 1e9, v_max = -1e9;
  int behind = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d sign((corner & 1) != 0 ? 1 : -1, (corner & 2) != 0 ? 1 : -1,
                               (corner & 4) != 0 ? 1 : -1);
    const Eigen::Vector3d p = part_S.centre + part_S.axes * half.cwiseProduct(sign);
    if (p.z() < kNearest) {
      ++behind;
      continue;
    }
    const double u = camera_.fx * p.x() / p.z() + camera_.cx;
    const double v = camera_.fy * p.y() / p.z() + camera_.cy;
    u_min = std::min(u_min, u), u_max = std::max(u_max, u);
    v_min = std::min(v_min, v), v_max = std::max(v_max, v);
  }
  if (behind == 8) return {};
  if (behind > 0) return {0, 0, camera_.width, camera_.height};
  const auto clamped = [](double value, int limit) {
    return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(limit)));
  };
  return {clamped(std::floor(u_min), camera_.width), clamped(std::floor(v_min), camera_.height),
          clamped(std::ceil(u_max) + 1, camera_.width),
          clamped(std::ceil(v_max) + 1, camera_.height)};
}

PreparedPart Raster::prepare(const Part& part_W, const Rigid& X_SW) const {
  Part part_S = part_W;
  part_S.centre = X_SW * part_W.centre;
  part_S.axes = X_SW.rotation.toRotationMatrix() * part_W.axes;
  PreparedPart prepared;
  prepared.shape = part_W.shape;
  prepared.taper = static_cast<float>(part_W.taper);
  prepared.albedo = part_W.albedo;
  prepared.tag = part_W.tag;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d m = part_S.axes.col(axis) / std::max(part_S.half[axis], 1e-4);
    const auto i = static_cast<std::size_t>(axis);
    for (int k = 0; k < 3; ++k)
      prepared.m[i][static_cast<std::size_t>(k)] = static_cast<float>(m[k]);
    prepared.c[i] = static_cast<float>(m.dot(part_S.centre));
  }
  prepared.rect = bounds(part_S);
  return prepared;
}

void Raster::draw(const PreparedPart& part, std::int32_t index, const RasterTarget& target) const {
  const DrawRect& rect = part.rect;
  if (rect.empty()) return;
  for (int v = rect.v; v < rect.v_end; ++v) {
    const std::size_t start = static_cast<std::size_t>(v) * static_cast<std::size_t>(target.width) +
                              static_cast<std::size_t>(rect.u);
    const Row row{ray_x_.data() + rect.u, target.inverse_depth.data() + start,
                  target.part.data() + start, rect.u_end - rect.u};
    switch (part.shape) {
      case Part::Shape::kEllipsoid:
        draw_ellipsoid(part, ray_y(v), index, camera_.fx, row);
        break;
      case Part::Shape::kCone:
        draw_cone(part, ray_y(v), index, camera_.fx, row);
        break;
      case Part::Shape::kBox:
        draw_box(part, ray_y(v), index, row);
        break;
    }
  }
}

}  // namespace wagonsight
