#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "drift/depth_grid.h"
#include "drift/registration.h"
#include "drift/static_surface.h"
#include "rig/ray_table.h"
#include "rig/rig.h"

namespace wagonsight {

struct DriftOptions {
  double alarm_shift_m = 0.010;
  double alarm_turn_rad = 0.3 * 0.017453292519943295;
  int learn_frames = 24;   // of the empty wagon, of each cell
  int learn_parts = 2;     // every second cell first, then the others: half of the memory
  int window_frames = 20;  // of one judgement; at two frames a second ten seconds
  int windows_to_alarm = 2;
  int windows_to_clear = 6;
};

// A box in W in which somebody is: what is seen there is not the wagon.
struct KeepOut {
  Eigen::Vector3f min_W, max_W;
};

// Holds one sensor's static depth against the day of calibration.
//
//   kLearning --learn_frames * learn_parts--> kWatching --windows_to_alarm judgements beyond-->
//   kMoved
//       ^                                         ^  <------windows_to_clear judgements
//       within------'
//       '-- no model given                        '-- model given
//
// It never changes a calibration. Allocates; not for the data path. One thread.
class SensorDrift {
 public:
  enum class State { kLearning, kWatching, kMoved };

  // `rays` must outlive it. `depth_m` by cell as in StaticModel; empty: it is learned.
  SensorDrift(const RigSensor& sensor, RayTable rays, std::span<const float> depth_m,
              const DriftOptions& options);

  // One sample of the grid's raw readings (see sample()) and where people are in it. True when a
  // judgement was made or learning has finished.
  bool add(std::span<const std::uint16_t> readings, std::span<const KeepOut> people);

  State state() const { return state_; }
  // The static depth by cell; empty while learning.
  std::span<const float> depth_m() const {
    return state_ == State::kLearning ? std::span<const float>{} : std::span(depth_m_);
  }
  // The last judgement that said anything.
  const SensorMotion& motion() const { return motion_; }
  // Most of what was solid is seen through: it looks elsewhere now.
  bool looks_elsewhere() const { return looks_elsewhere_; }
  int judgements() const { return judgements_; }
  const DepthGrid& grid() const { return grid_; }

 private:
  void learn(std::span<const std::uint16_t> readings, std::span<const KeepOut> people);
  void settle(int part);
  void begin_watching();
  void gather(std::span<const std::uint16_t> readings, std::span<const KeepOut> people);
  void judge();
  float depth_of(std::uint16_t reading) const;
  bool kept_out(std::size_t cell, float depth, std::span<const KeepOut> people) const;

  RigSensor sensor_;
  RayTable rays_;
  DepthGrid grid_;
  DriftOptions options_;
  State state_ = State::kLearning;
  std::vector<float> depth_m_;
  std::unique_ptr<StaticSurface> surface_;
  std::vector<std::uint16_t> learned_;  // learn_frames readings a cell of one part
  struct Sum {
    float metres = 0;
    std::uint16_t count = 0, beyond = 0;
  };
  std::vector<Sum> window_;    // by point of the surface
  std::vector<float> gate_m_;  // likewise: readings farther off are not of the surface
  int frames_ = 0, judgements_ = 0, beyond_ = 0, within_ = 0;
  bool looks_elsewhere_ = false;
  SensorMotion motion_;
};

}  // namespace wagonsight
