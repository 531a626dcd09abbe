#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>

#include "base/bounded_vector.h"
#include "base/capacities.h"
#include "base/time.h"
#include "foreground/foreground.h"
#include "rig/rig.h"

// The foregrounds of all sensors at one instant as one cloud in the world: line 18 of the paper's
// Algorithm 1. There is no registration at run time: poses come from calibration, and what moved
// between a sensor's exposure and the common instant is moved along by its track's velocity.
namespace wagonsight {

// One voxel of foreground that at least one sensor saw. World frame, metres.
struct FusedPoint {
  float x = 0, y = 0, z = 0;
  float sigma = 0;            // along the ray of the sensor that saw it best, metres
  float area_m2 = 0;          // of surface across the ray: pixels * depth^2 / (fx fy)
  float away_x = 0;           // horizontal part of the unit vector from the sensors to the point,
  float away_y = 0;           // so its length is the cosine of the elevation
  std::uint16_t sensors = 0;  // bit i: sensor i saw it
  std::uint16_t blob = 0;     // of the sensor that saw it first
  std::uint8_t sensor = 0;    // that sensor
};

// Image borders at which a point lies; what lies there goes on beyond it, unseen.
enum Border : std::uint8_t { kNoBorder = 0, kLeft = 1, kRight = 2, kTop = 4, kBottom = 8 };

// What one sensor's foreground point became.
struct Contribution {
  std::uint32_t point = 0;  // index into FusedCloud::points
  float depth = 0;          // along the sensor's optical axis, metres
  std::uint16_t pixels = 0;
  std::uint16_t u = 0, v = 0;  // where the sensor sees it, pixels
  std::uint8_t sensor = 0;
  std::uint8_t borders = kNoBorder;  // bits of Border
};

struct FusedCloud {
  FusedCloud() : points(kFusedPointsMax), contributions(kContributionsMax) {}

  BoundedVector<FusedPoint> points;
  BoundedVector<Contribution> contributions;
  std::uint32_t dropped = 0;  // foreground points that did not fit
};

// How something at a place moves, from the tracks of the FrameSet before: points within `radius`
// of (x, y) at the common instant share its velocity.
struct MotionHint {
  float x = 0, y = 0;
  float radius = 0;
  float vx = 0, vy = 0;
};

// One sensor's part of the instant.
struct ForegroundView {
  const Foreground* foreground = nullptr;  // null: the sensor has no frame at this instant
  Duration skew{};                         // its exposure minus the common instant
};

class Fusion {
 public:
  // Points closer than about `voxel_m` (metres) become one. Allocates here and never again.
  Fusion(const Rig& rig, double voxel_m);

  // `views` by sensor index. The result stays valid until the next call. Deterministic: sensors
  // are taken in their order. What exceeds the cloud's capacity is dropped and counted.
  const FusedCloud& fuse(std::span<const ForegroundView> views, std::span<const MotionHint> hints);

 private:
  struct SensorModel {  // world to sensor, single precision
    std::array<float, 9> rotation_SW{};
    std::array<float, 3> position_W{};
    float fx = 0, fy = 0, cx = 0, cy = 0;
    int width = 0, height = 0;
    float margin = 0;  // pixels from the border that count as cut by it
  };
  struct Cell {
    // Of the voxel, in voxels, their low 16 bits: no wagon has 65,536 voxels along a side.
    std::int16_t x = 0, y = 0, z = 0;
    std::uint16_t point = 0;
    std::uint32_t stamp = 0;  // generation in which this entry was written
  };

  void add_view(std::size_t sensor_index, const ForegroundView& view,
                std::span<const MotionHint> hints);
  // Index of the fused point in the voxel of (x, y, z), made when new; kNoPoint when full.
  std::uint32_t point_at(float x, float y, float z, bool& is_new);

  std::array<SensorModel, kSensorsMax> sensors_{};
  float voxels_per_metre_;
  FreshArray<Cell> table_;
  std::uint32_t generation_ = 0;
  FusedCloud cloud_;
};

}  // namespace wagonsight
