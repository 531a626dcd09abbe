#pragma once

#include <span>

#include "base/bounded_vector.h"
#include "fusion/fused_cloud.h"
#include "people/detect.h"
#include "snapshot/snapshot.h"

namespace wagonsight {

// The shape of one detected person at this instant; what a Person says of it. World frame, metres.
struct BodyShape {
  Box box;
  Ellipsoid ellipsoid;
  bool has_head = false;
  std::array<double, 3> head{};  // centre
  bool has_shoulders = false;
  // Of the line through both shoulders: its ends, in no order; who is left needs a facing.
  std::array<double, 3> shoulder_a{}, shoulder_b{};
};

// Measures all people of one cloud in two passes over its points.
class Describer {
 public:
  Describer() : sums_(kPeopleMax), shapes_(kPeopleMax) {}  // allocates here and never again

  // `labels` by point, as Detector::labels(). The result by detection, valid until the next call.
  std::span<const BodyShape> describe(const FusedCloud& cloud,
                                      std::span<const std::uint16_t> labels,
                                      std::span<const Detection> detections);

 private:
  struct Sums {
    double area = 0;
    std::array<double, 3> first{};   // of x, y, z
    std::array<double, 6> second{};  // xx, xy, xz, yy, yz, zz
    double head_area = 0, head_x = 0, head_y = 0;
    double shoulder_area = 0, shoulder_x = 0, shoulder_y = 0;
    double shoulder_xx = 0, shoulder_xy = 0, shoulder_yy = 0;
    double yaw_cos = 1, yaw_sin = 0;
    double low_a = 1e9, high_a = -1e9, low_b = 1e9, high_b = -1e9;  // along and across yaw
  };

  void finish(const Detection& detection, const Sums& sums, BodyShape& shape) const;

  BoundedVector<Sums> sums_;
  BoundedVector<BodyShape> shapes_;
};

}  // namespace wagonsight
