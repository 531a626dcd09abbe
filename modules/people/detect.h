#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "base/bounded_vector.h"
#include "fusion/fused_cloud.h"
#include "people/ground_segments.h"
#include "people/head_modes.h"
#include "snapshot/snapshot.h"
#include "wagon/wagon.h"

namespace wagonsight {

inline constexpr std::uint16_t kNoDetection = UINT16_MAX;
// People whose outlines can be one: a crowd before a door.
inline constexpr std::size_t kTogetherCount = 16;

// Where a track expects a person at this instant: it decides in doubt whether what stands close
// together is one or two.
struct PersonPrior {
  float x = 0, y = 0;
  float head_top = 0;    // of the last sight, metres
  bool settled = false;  // well known and hardly moving: sits or stands
  bool lying = false;
  float yaw = 0;       // of its outline's longer side, radians from x
  bool known = false;  // nothing of this person is much higher than head_top
};

// Something that is a person by itself, or may be the part of one that a track expects. World
// frame, metres.
struct Detection {
  float x = 0, y = 0;         // the torso's centre on the floor
  float sigma = 0;            // of x and of y
  float top = 0;              // highest point above the floor
  float bottom = 0;           // lowest
  float length = 0;           // longest horizontal extent (10th to 90th percentile of the points)
  float width = 0;            // across that
  float area_m2 = 0;          // of its visible surface
  bool stands_alone = false;  // enough of a person to begin a track
  bool like_a_thing = false;  // upright, low and long: a pram, or somebody who bends down
  bool cut_top = false;       // the head may be beyond an image border
  bool cut_side = false;      // the body goes on beyond an image border
  std::uint32_t points = 0;
  FixedVector<ViewAttributes, kSensorsMax> views;
  struct Cut {  // pixels of a view, in the order of `views`, that touch an image border
    std::uint32_t top = 0, side = 0;
  };
  std::array<Cut, kSensorsMax> cuts{};
};

// What the detector takes a person for. All lengths are those of human bodies.
struct DetectOptions {
  double standing_min_m = 0.8;  // top of the smallest person to be found upright
  // Whoever is smaller than this is a child, slim and on its feet; a pram is as high but longer.
  double child_max_m = 1.15;
  double child_length_max_m = 0.42;
  double child_width_max_m = 0.26;
  double child_tall_min_m = 0.6;  // from its lowest visible point
  double child_bottom_max_m = 0.3;
  double child_area_min_m2 = 0.25;
  double area_min_m2 = 0.10;        // visible surface of a person nobody expects
  double area_part_min_m2 = 0.025;  // of one whom a track expects: half a head
  // A body is solid: its visible surface fills this share of its outline's box at least.
  double solid_min = 0.3;
  double lying_area_min_m2 = 0.3;
  double lying_length_min_m = 0.8;
};

class Detector {
 public:
  // People are looked for in `inside`. Allocates here and never again.
  explicit Detector(const Bounds& inside, const DetectOptions& options = {});

  // The people of one fused cloud, at most kPeopleMax, highest first. Valid until the next call.
  std::span<const Detection> detect(const FusedCloud& cloud, std::span<const PersonPrior> priors);
  // By point of that cloud: the detection it belongs to, or kNoDetection.
  std::span<const std::uint16_t> labels() const { return labels_.span(); }

 private:
  // Sums over the points of a part; parts are merged by adding them.
  struct Part {
    double area = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;  // area-weighted
    float top = 0, bottom = 0;
    float top_x = 0, top_y = 0;
    std::uint32_t points = 0;
    std::uint16_t merged_into = kNoDetection;  // itself when it stands
    std::uint16_t detection = kNoDetection;

    // Longest horizontal extent if the surface were spread evenly.
    double length() const;
    double mean_x() const { return x / area; }
    double mean_y() const { return y / area; }
  };

  void gather_parts(const FusedCloud& cloud);
  void merge_parts(std::span<const PersonPrior> priors);
  bool same_person(const Part& high, const Part& low, std::span<const PersonPrior> priors) const;
  bool lies_there(const Part& low, const Part& high, std::span<const PersonPrior> priors) const;
  void merge(std::size_t low, std::size_t high);
  void split_crowds(const FusedCloud& cloud, std::span<const PersonPrior> priors);
  void place_priors(const FusedCloud& cloud, std::span<const PersonPrior> priors);
  void join_mixed_up(std::span<const PersonPrior> priors);
  void expect_in(std::size_t part, std::span<const PersonPrior> priors);
  void gather_crowns(const FusedCloud& cloud, std::size_t part);
  void find_expected_heads(const FusedCloud& cloud);
  void find_centres(const FusedCloud& cloud, std::size_t part);
  bool is_centre(double x, double y) const;
  bool split_off_lying(const FusedCloud& cloud, std::size_t part,
                       std::span<const PersonPrior> priors);
  struct LyingBody;
  void split_lying(const FusedCloud& cloud, std::span<const PersonPrior> priors);
  bool is_in(std::size_t point, std::size_t part) const;
  bool find_child_beside(const FusedCloud& cloud, std::size_t part, HeadMode& adult,
                         HeadMode& child) const;
  void split(const FusedCloud& cloud, std::size_t part, std::span<const HeadMode> heads);
  void add_empty_part();
  void add_point(Part& part, const FusedPoint& p) const;
  void measure(const FusedCloud& cloud);
  void measure_positions(const FusedCloud& cloud);
  void find_lying_torso(const FusedCloud& cloud, std::uint16_t index);
  void add_views(const FusedCloud& cloud);
  void judge();
  std::uint16_t part_root(std::uint16_t part) const;

  DetectOptions options_;
  GroundSegments segments_;
  HeadModes head_modes_;
  struct Place {  // of a prior: the part it belongs to
    std::uint16_t part = kNoDetection;
    float support_m2 = 0;
  };
  FixedVector<Place, kTracksMax> places_;  // by prior
  struct Expected : HeadMode {
    float head_top = 0;
    float head_area_m2 = 0;  // of what looks like its head near there, at (x, y) then
  };
  FixedVector<Expected, kTogetherCount> expected_;     // tracks within the part at hand
  bool all_settled_ = false;                           // and whether all of them hardly move
  FixedVector<HeadMode, 2 * kTogetherCount> centres_;  // of the people in the part at hand
  BoundedVector<std::uint32_t> crowns_;  // points of the part at hand with nothing above them
  BoundedVector<Part> parts_;
  BoundedVector<std::uint16_t> part_labels_;  // by point
  BoundedVector<std::uint16_t> labels_;       // by point
  BoundedVector<Detection> detections_;
};

}  // namespace wagonsight
