#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "base/fixed_vector.h"
#include "simulate/part.h"
#include "simulate/scene.h"

namespace wagonsight {

inline constexpr std::size_t kWaypointsMax = 32;
using Waypoints = FixedVector<Eigen::Vector2d, kWaypointsMax>;

// Where a passenger can walk: a grid over the floor with the distance to the nearest obstacle, and
// shortest paths (A*) that keep clear of obstacles. Allocates only when made.
class FloorPlan {
 public:
  explicit FloorPlan(const Scene& scene);

  // Corners of a way from `from` to `to`, the goal included; straight where nothing is in between.
  // A start or a goal within an obstacle is left or reached by the shortest way.
  void find_way(const Eigen::Vector2d& from, const Eigen::Vector2d& to, Waypoints& way);

  // Whether a body's middle fits at a place.
  bool walkable(const Eigen::Vector2d& p) const;
  double clearance(const Eigen::Vector2d& p) const;  // metres, at most kClearanceMax
  // Whether the straight way keeps its distance from obstacles.
  bool straight(const Eigen::Vector2d& a, const Eigen::Vector2d& b, double clearance_min) const;

 private:
  static constexpr double kCell = 0.1;
  static constexpr double kClearanceMax = 0.6;
  struct Open {
    float estimate;
    std::int32_t cell;
  };

  int cell_of(const Eigen::Vector2d& p) const;
  Eigen::Vector2d middle_of(int cell) const;
  int nearest_walkable(int cell) const;
  bool search(int start, int goal);
  void expand(int cell, int goal);

  int columns_, rows_;
  double length_, width_;
  std::vector<float> clearance_;
  // A*'s working memory, made once.
  std::vector<float> cost_;
  std::vector<std::int32_t> from_, trail_;
  std::vector<Open> open_;
};

}  // namespace wagonsight
