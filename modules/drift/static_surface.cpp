#include "drift/static_surface.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <nanoflann.hpp>

namespace wagonsight {
namespace {

// nanoflann asks for these names.
struct Cloud {
  const std::vector<StaticSurface::Point>* points;

  std::size_t kdtree_get_point_count() const { return points->size(); }
  float kdtree_get_pt(std::size_t index, std::size_t axis) const {
    return (*points)[index].p_S[static_cast<Eigen::Index>(axis)];
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

Eigen::Vector3f point_at(const DepthGrid& grid, RayTable rays, std::size_t cell, float depth) {
  const PixelRay ray = rays[grid.pixel(cell)];
  return {depth * kRayScale * static_cast<float>(ray.x),
          depth * kRayScale * static_cast<float>(ray.y), depth};
}

}  // namespace

struct StaticSurface::Index {
  using Tree =
      nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Cloud, float>, Cloud,
                                          3>;
  explicit Index(const std::vector<Point>& points)
      : cloud{&points}, tree(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(12)) {
    if (!points.empty()) tree.buildIndex();
  }
  Cloud cloud;
  Tree tree;
};

StaticSurface::StaticSurface(const DepthGrid& grid, RayTable rays, std::span<const float> depth_m) {
  const int columns = grid.columns(), rows = grid.rows();
  constexpr int kReach = 2;  // cells: 12 cm across at 3 m
  constexpr int kNeighboursMin = 14;
  constexpr float kCosineMin = 0.26F;
  for (int row = kReach; row + kReach < rows; ++row)
    for (int column = kReach; column + kReach < columns; ++column) {
      const auto cell = static_cast<std::size_t>(row * columns + column);
      const float z = depth_m[cell];
      if (!(z > 0) || rays[grid.pixel(cell)].x == kNoRay) continue;
      const float gap = 0.03F + 0.06F * z;
      std::array<Eigen::Vector3f, 25> near;
      std::size_t count = 0;
      Eigen::Vector3f mean = Eigen::Vector3f::Zero();
      for (int dv = -kReach; dv <= kReach; ++dv)
        for (int du = -kReach; du <= kReach; ++du) {
          const auto other = static_cast<std::size_t>((row + dv) * columns + column + du);
          if (!(depth_m[other] > 0) || std::abs(depth_m[other] - z) > gap ||
              rays[grid.pixel(other)].x == kNoRay)
            continue;
          near[count] = point_at(grid, rays, other, depth_m[other]);
          mean += near[count++];
        }
      if (count < kNeighboursMin) continue;
      mean /= static_cast<float>(count);
      Eigen::Matrix3f scatter = Eigen::Matrix3f::Zero();
      for (std::size_t i = 0; i < count; ++i)
        scatter += (near[i] - mean) * (near[i] - mean).transpose();
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> eigen(scatter);
      const float off =
          std::sqrt(std::max(0.0F, eigen.eigenvalues()[0]) / static_cast<float>(count));
      Eigen::Vector3f normal = eigen.eigenvectors().col(0);
      const Eigen::Vector3f p = point_at(grid, rays, cell, z);
      if (normal.dot(p) > 0) normal = -normal;
      if (off > 0.004F + 0.002F * z * z || -normal.dot(p.normalized()) < kCosineMin) continue;
      // The plane's own depth along the ray: one cell's noise is evened out by its neighbours.
      const float along = normal.dot(mean) / normal.dot(p);
      points_.push_back({along * p, normal, static_cast<std::uint32_t>(cell)});
    }
  index_ = std::make_unique<Index>(points_);
}

StaticSurface::~StaticSurface() = default;

const StaticSurface::Point* StaticSurface::nearest(const Eigen::Vector3f& p_S,
                                                   float reach_m) const {
  if (points_.empty()) return nullptr;
  std::uint32_t index = 0;
  float distance2 = 0;
  if (index_->tree.knnSearch(p_S.data(), 1, &index, &distance2) == 0 ||
      distance2 > reach_m * reach_m)
    return nullptr;
  return &points_[index];
}

}  // namespace wagonsight
