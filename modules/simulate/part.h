#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace wagonsight {

// One solid of the simulated world: an ellipsoid, a (tapered, elliptic) cone frustum without its
// ends, or a box. Its local axes are the columns of `axes`; `half` are its half sizes along them.
// A cone stands along the third axis; its radii half[0], half[1] hold at the middle and grow by
// the share `taper` towards the positive end, so 0 is a cylinder.
struct Part {
  enum class Shape : std::uint8_t { kEllipsoid, kCone, kBox };

  Shape shape = Shape::kEllipsoid;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  Eigen::Vector3d half = Eigen::Vector3d::Ones();
  double taper = 0;
  float albedo = 0.5F;   // share of infrared light that is scattered back
  std::int32_t tag = 0;  // whose it is: passenger index + 1, or 0
};

inline Part box_part(const Eigen::Vector3d& min, const Eigen::Vector3d& max, float albedo) {
  Part part;
  part.shape = Part::Shape::kBox;
  part.centre = 0.5 * (min + max);
  part.half = 0.5 * (max - min);
  part.albedo = albedo;
  return part;
}

}  // namespace wagonsight
