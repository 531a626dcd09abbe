#include "evaluate/surface.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace wagonsight {
namespace {

using Cloud = std::vector<std::array<float, 3>>;

// A square of 1 m at height z, a point every 2 cm.
Cloud square(float z) {
  Cloud points;
  for (int i = 0; i <= 50; ++i) {
    for (int j = 0; j <= 50; ++j) {
      points.push_back({0.02F * static_cast<float>(i), 0.02F * static_cast<float>(j), z});
    }
  }
  return points;
}

TEST(SurfaceError, MeasuresTheDistanceOfParallelPlanes) {
  const auto error = surface_error(square(0.03F), square(0));
  ASSERT_TRUE(error);
  EXPECT_NEAR(error->accuracy.mean_m, 0.03, 1e-6);
  EXPECT_NEAR(error->accuracy.max_m, 0.03, 1e-6);
  EXPECT_NEAR(error->completeness.p95_m, 0.03, 1e-6);
  EXPECT_EQ(error->covered_share, 1);
}

TEST(SurfaceError, TellsWhatWasNotSeen) {
  Cloud half = square(0);
  std::erase_if(half, [](const auto& point) { return point[0] > 0.5F; });
  const auto error = surface_error(half, square(0), 0.01);
  ASSERT_TRUE(error);
  EXPECT_NEAR(error->accuracy.max_m, 0, 1e-6);
  EXPECT_NEAR(error->completeness.max_m, 0.5, 1e-5);
  EXPECT_NEAR(error->covered_share, 26.0 / 51.0, 1e-9);
}

TEST(SurfaceError, RefusesAnEmptyCloud) {
  const auto error = surface_error({}, square(0));
  ASSERT_FALSE(error);
  EXPECT_NE(error.error().message.find("cloud"), std::string::npos);
  EXPECT_FALSE(surface_error(square(0), {}));
}

Cloud random_cloud() {
  const auto count = *rc::gen::inRange<std::size_t>(1, 80);
  const auto coordinates =
      *rc::gen::container<std::vector<int>>(3 * count, rc::gen::inRange(-1000, 1000));
  Cloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    cloud.push_back({0.01F * static_cast<float>(coordinates[3 * i]),
                     0.01F * static_cast<float>(coordinates[3 * i + 1]),
                     0.01F * static_cast<float>(coordinates[3 * i + 2])});
  }
  return cloud;
}

// The oracle looks at every pair.
double worst_nearest(const Cloud& from, const Cloud& to) {
  double worst = 0;
  for (const auto& a : from) {
    double nearest = 1e300;
    for (const auto& b : to) {
      nearest =
          std::min(nearest, std::hypot(static_cast<double>(a[0]) - static_cast<double>(b[0]),
                                       static_cast<double>(a[1]) - static_cast<double>(b[1]),
                                       static_cast<double>(a[2]) - static_cast<double>(b[2])));
    }
    worst = std::max(worst, nearest);
  }
  return worst;
}

RC_GTEST_PROP(SurfaceError, EqualsLookingAtEveryPair, ()) {
  const Cloud cloud = random_cloud(), truth = random_cloud();
  const auto error = surface_error(cloud, truth);
  RC_ASSERT(std::abs(error->accuracy.max_m - worst_nearest(cloud, truth)) < 1e-4);
  RC_ASSERT(std::abs(error->completeness.max_m - worst_nearest(truth, cloud)) < 1e-4);
}

}  // namespace
}  // namespace wagonsight
