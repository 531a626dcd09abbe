#pragma once

#include <rapidcheck.h>

#include "geometry/angles.h"
#include "geometry/transform.h"

// Random values for the properties; call within RC_GTEST_PROP.
namespace wagonsight::test {

inline double real_in(double low, double high) {
  constexpr std::int64_t kSteps = 1'000'000'000;
  return low + (high - low) * static_cast<double>(*rc::gen::inRange<std::int64_t>(0, kSteps + 1)) /
                   static_cast<double>(kSteps);
}

inline Eigen::Vector3d vector_in(double bound) {
  return {real_in(-bound, bound), real_in(-bound, bound), real_in(-bound, bound)};
}

inline Eigen::Quaterniond rotation() {
  Eigen::Vector4d q;
  do {
    q = {real_in(-1, 1), real_in(-1, 1), real_in(-1, 1), real_in(-1, 1)};
  } while (q.norm() < 0.1);
  return Eigen::Quaterniond(q).normalized();
}

inline Rigid rigid() {
  return {rotation(), vector_in(20)};
}

inline Similarity similarity() {
  return {real_in(0.2, 5), rotation(), vector_in(20)};
}

}  // namespace wagonsight::test
