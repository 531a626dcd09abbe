#include "evaluate/surface.h"

#include <algorithm>
#include <cmath>
#include <nanoflann.hpp>
#include <vector>

#include "evaluate/statistics.h"

namespace wagonsight {
namespace {

using Points = std::span<const std::array<float, 3>>;

// The face nanoflann asks for; its names.
struct PointSource {
  Points points;

  std::size_t kdtree_get_point_count() const { return points.size(); }
  float kdtree_get_pt(std::size_t index, std::size_t axis) const { return points[index][axis]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Tree =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, PointSource, double>,
                                        PointSource, 3, std::size_t>;

std::vector<double> distances(Points from, Points to) {
  const PointSource source{to};
  const Tree tree(3, source, nanoflann::KDTreeSingleIndexAdaptorParams(10));
  std::vector<double> result;
  result.reserve(from.size());
  for (const std::array<float, 3>& point : from) {
    std::size_t nearest = 0;
    double squared = 0;
    tree.knnSearch(point.data(), 1, &nearest, &squared);
    result.push_back(std::sqrt(squared));
  }
  return result;
}

SurfaceDistances summarise(std::span<const double> values) {
  SurfaceDistances summary;
  double sum = 0, squares = 0;
  for (const double value : values) {
    sum += value;
    squares += value * value;
  }
  const auto count = static_cast<double>(values.size());
  summary.mean_m = sum / count;
  summary.rms_m = std::sqrt(squares / count);
  summary.median_m = quantile(values, 0.5);
  summary.p95_m = quantile(values, 0.95);
  summary.max_m = quantile(values, 1);
  return summary;
}

}  // namespace

Result<SurfaceError> surface_error(Points cloud, Points truth, double covered_m) {
  if (cloud.empty()) return fail("the cloud has no point; export one in which somebody is seen");
  if (truth.empty()) return fail("the true surface has no point; sample it first");
  const std::vector<double> to_cloud = distances(truth, cloud);
  const auto covered = std::count_if(to_cloud.begin(), to_cloud.end(),
                                     [&](double distance) { return distance <= covered_m; });
  SurfaceError error;
  error.accuracy = summarise(distances(cloud, truth));
  error.completeness = summarise(to_cloud);
  error.covered_share = static_cast<double>(covered) / static_cast<double>(to_cloud.size());
  return error;
}

}  // namespace wagonsight
