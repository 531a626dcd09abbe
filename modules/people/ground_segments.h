#pragma once

#include <cstdint>
#include <span>

#include "base/bounded_vector.h"
#include "fusion/fused_cloud.h"
#include "wagon/wagon.h"

// The ground plan of what stands in the room: the highest point over every 5 cm of floor, cut into
// hills. A hill keeps its name when it meets a higher one only if it rises clearly above their
// pass, as one head does above the shoulders between two people.
namespace wagonsight {

inline constexpr std::uint16_t kNoSegment = UINT16_MAX;

class GroundSegments {
 public:
  // A grid over the floor of `inside`. Allocates here and never again.
  explicit GroundSegments(const Bounds& inside);

  // Labels every point of the cloud that lies inside and above the floor's own noise. Segments are
  // numbered from 0 in the order of their height, highest first.
  void segment(const FusedCloud& cloud);

  std::size_t count() const { return count_; }
  // By point of the cloud: its segment, or kNoSegment.
  std::span<const std::uint16_t> labels() const { return labels_.span(); }
  // The highest point over the cell that a point of the cloud lies in, metres; 0 outside.
  float top_over(std::size_t point) const {
    return point_cells_[point] == kOutside ? 0.0F : cells_[point_cells_[point]].top;
  }

 private:
  static constexpr std::uint32_t kOutside = UINT32_MAX;

  struct Cell {
    float top = 0;      // metres above the floor; 0: empty
    float area_m2 = 0;  // of surface over the cell
    std::uint32_t label = 0;
  };
  struct Hill {
    float peak = 0;
    std::uint32_t peak_cell = 0;
    float area_m2 = 0;
    std::uint32_t parent = 0;
    std::uint16_t number = kNoSegment;
  };

  void raise(const FusedCloud& cloud);
  void bridge_gaps();
  void order_by_height();
  void flood();
  std::uint32_t root_of(std::uint32_t hill) const;
  std::uint32_t nearer_peak(std::uint32_t cell, std::uint32_t a, std::uint32_t b) const;
  std::uint32_t cell_of(float x, float y) const;

  Bounds inside_;
  double cells_per_metre_;
  int width_ = 0;   // cells along x, with a margin of one on either side
  int height_ = 0;  // along y
  BoundedVector<Cell> cells_;
  BoundedVector<float> bridged_;
  BoundedVector<std::uint32_t> occupied_;  // cells that are not empty, any order
  BoundedVector<std::uint32_t> ordered_;   // the same, highest first
  BoundedVector<Hill> hills_;
  BoundedVector<std::uint32_t> point_cells_;  // by point
  BoundedVector<std::uint16_t> labels_;
  std::size_t count_ = 0;
};

}  // namespace wagonsight
