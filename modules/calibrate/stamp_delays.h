#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"

namespace wagonsight {

// How much later than its light each sensor stamps its frames, from one target that several sensors
// saw move: arrival times cannot tell, but at a wrong time a moving thing is at a wrong place.
//
// All tracks are fitted at once. The target's way P(t) is a cubic B-spline, and sensor i, whose
// poses and readings may be a little off, told of it
//
//     p_i(t) = P(t - delay_i) + offset_i
//
// Least squares with a robust loss (Ceres) over the spline, the delays and the offsets. A delay
// common to all sensors and an offset common to all cannot be told and are not needed: the earliest
// delay is zero. (The joint estimate of a spline and of time offsets: Furgale, Rehder and Siegwart,
// IROS 2013.)

struct TargetSample {
  double t_s = 0;  // by the sensor's time stamps
  Eigen::Vector3d p_W = Eigen::Vector3d::Zero();
};
struct TargetTrack {  // by time
  std::string name;
  std::vector<TargetSample> samples;
};

struct SensorDelay {
  double delay_s = 0;                                  // later than the earliest sensor's
  double sigma_s = 0;                                  // against the mean of all
  Eigen::Vector3d offset_W = Eigen::Vector3d::Zero();  // against the mean of all
  double rms_m = 0;                                    // of what is left, a coordinate
  int samples = 0;
};

struct StampDelayOptions {
  double knot_s = 0.06;           // of the spline: a hand turns round in three times that
  double acceleration_mps2 = 30;  // of a waved target, roughly; ties what nobody saw
  double sigma_max_s = 0.003;     // what is known less well is not known
  double moving_mps_min = 0.3;    // what is slower tells nothing
  int moving_samples_min = 20;    // that two sensors have in common to be tied together
};

// One result a track. The Error names the sensors that never saw the target, that cannot be tied to
// the others, or whose delay stays uncertain, and says what to do. Deterministic; allocates.
Result<std::vector<SensorDelay>> estimate_stamp_delays(std::span<const TargetTrack> tracks,
                                                       const StampDelayOptions& options = {});

}  // namespace wagonsight
