#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "base/bounded_vector.h"
#include "fusion/fused_cloud.h"
#include "wagon/wagon.h"

namespace wagonsight {

// What is taken for a head above shoulders when there is no background to tell people from
// furniture. Lengths of human bodies, metres.
struct UprightOptions {
  float top_min_m = 0.95F, top_max_m = 2.15F;  // of the crown above the floor: sitting to standing
  float head_width_min_m = 0.14F, head_width_max_m = 0.30F;
  float shoulders_min_m = 0.28F;
  float shoulders_wider_m = 0.08F;  // than the head
  // A body from the crown to the chest is this flat along the view (standard deviation).
  float depth_spread_max_m = 0.11F;
  // Share of the outline beside and above a head that may be surface at its distance.
  float beside_max = 0.7F, above_max = 0.15F;
  // Noisier surface has no shape: a Kinect's from 6 m on.
  float sigma_max_m = 0.07F;
};

// People in a cloud of everything: keeps the surroundings of whatever has the outline of a head
// above shoulders, seen from the sensor that saw it, and drops the rest. For recordings that are
// too short to learn a background. Every highest place of the ground plan is tried as a crown.
class UprightShapes {
 public:
  // Looks over the floor of `inside`. Allocates here and never again: as much as a second cloud.
  explicit UprightShapes(const Bounds& inside, const UprightOptions& options = {});

  // The points of `cloud` that belong to upright people; valid until the next call. Costs some
  // tens of milliseconds.
  const FusedCloud& select(const FusedCloud& cloud);

 private:
  static constexpr std::size_t kBins = 51;
  struct Head {  // the middle of a head and the directions in which its sensor sees it
    float x = 0, y = 0, top = 0;
    float away_x = 0, away_y = 0;
    std::uint8_t sensor = 0;
  };
  struct Near {  // a point as seen from a head: to its left, below its crown, behind it
    float across = 0, below = 0, behind = 0, area_m2 = 0, sigma = 0;
    std::uint32_t point = 0;
  };
  using Outline = std::array<float, kBins>;  // surface by bins across the view

  void find_crowns(const FusedCloud& cloud);
  void gather(const FusedCloud& cloud, const Head& head);
  bool centre(const FusedCloud& cloud, Head& head);
  bool is_person() const;
  Outline outline(float below_min, float below_max, float depth) const;
  float clutter(float across_min, float across_max, float below_min, float below_max) const;
  float depth_spread() const;
  void copy_kept(const FusedCloud& cloud);

  Bounds inside_;
  UprightOptions options_;
  int columns_ = 0, rows_ = 0;
  float cells_per_m_ = 0;
  BoundedVector<std::uint32_t> highest_;  // by cell: its highest point
  BoundedVector<Head> crowns_;
  BoundedVector<Near> near_;           // of one head
  BoundedVector<std::uint32_t> kept_;  // by point: its new index, or kDropped
  FusedCloud selected_;
};

}  // namespace wagonsight
