#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "drift/depth_grid.h"
#include "rig/ray_table.h"

namespace wagonsight {

// The static wagon as one sensor saw it on the day of calibration: points with normals in S, found
// again by nearness. Allocates when made; then read-only, any thread.
class StaticSurface {
 public:
  // `depth_m` by cell of the grid, 0 where nothing static is known. Cells without a plane about
  // them (edges, cables, plants) and planes seen at less than 15 degrees get no point.
  StaticSurface(const DepthGrid& grid, RayTable rays, std::span<const float> depth_m);
  ~StaticSurface();
  StaticSurface(const StaticSurface&) = delete;
  StaticSurface& operator=(const StaticSurface&) = delete;

  struct Point {
    Eigen::Vector3f p_S, normal_S;
    std::uint32_t cell = 0;
  };
  std::span<const Point> points() const { return points_; }
  // The nearest point within `reach_m`, or nullptr.
  const Point* nearest(const Eigen::Vector3f& p_S, float reach_m) const;

 private:
  struct Index;
  std::vector<Point> points_;
  std::unique_ptr<Index> index_;
};

}  // namespace wagonsight
