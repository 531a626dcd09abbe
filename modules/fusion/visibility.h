#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "base/bounded_vector.h"
#include "frame/frame.h"
#include "rig/rig.h"
#include "wagon/wagon.h"

// What the sensors can tell of the air in the wagon: a place is free because some sensor saw
// through it, occupied because one saw a surface in it, or nobody could see it. What is not
// observed is never taken for free.
namespace wagonsight {

enum class Visibility : std::uint8_t { kUnobserved, kFree, kOccupied };

// How an upright body at a place would have been seen at one instant; shares of its samples, each
// sample counted once by the sensor that tells most. They sum to one.
struct ColumnView {
  float free = 0;        // some sensor looks through it: nobody is there
  float surface = 0;     // some sensor sees a surface right there
  float occluded = 0;    // in view, but only behind something nearer
  float no_reading = 0;  // in view, but there is no depth (glass, dark, a shadow, a lost frame)
  float outside = 0;     // in no sensor's view
};

class VisibilityGrid {
 public:
  // Cells of `cell_m` metres over `inside`, made coarser until kCellsMax hold it. Allocates here.
  VisibilityGrid(const Rig& rig, const Bounds& inside, double cell_m = 0.15);

  // Takes the frames of an instant, which must stay until the next call, and looks at the next
  // cells in turn: all of them once in kScan seconds. Sensors without a frame say nothing.
  void update(const FrameSet& frames);

  // What was last seen there; unobserved when that is longer ago than kMemory. Outside of the grid
  // nothing is observed.
  Visibility at(double x, double y, double z) const;
  // Share of the cells with their centre in the box that are observed, 0..1; 0 for an empty box.
  double observed_share(const Bounds& box) const;

  // Looks at the depth images of the last update directly, for a body of `height` metres that
  // stands at (x, y). Costs 12 projections a sensor.
  ColumnView look_at_column(double x, double y, double height) const;

  static constexpr double kScan = 0.5;    // seconds
  static constexpr double kMemory = 1.5;  // seconds

 private:
  enum class Sight : std::uint8_t { kOutside, kNoReading, kOccluded, kSurface, kFree };
  struct Cell {
    float seen_s = -1e9F;  // seconds since the first FrameSet
    Visibility state = Visibility::kUnobserved;
  };

  Sight look(const Eigen::Vector3d& p_W, double margin) const;
  Eigen::Vector3d centre_of(std::size_t index) const;

  Rig rig_;
  std::array<Eigen::Matrix3d, kSensorsMax> R_SW_;
  Bounds inside_;
  double cell_m_;
  std::array<int, 3> size_{};
  BoundedVector<Cell> cells_;
  std::array<SensorFrame, kSensorsMax> frames_{};  // of the last update
  std::size_t next_ = 0;
  bool started_ = false;
  HostTime start_{};
  double now_s_ = 0;
  double budget_ = 0;
};

}  // namespace wagonsight
