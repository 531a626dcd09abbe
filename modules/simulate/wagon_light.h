#pragma once

#include <Eigen/Core>
#include <vector>

#include "simulate/scene.h"

// Visible light in the wagon: lamps, daylight through the windows, and the sun's patches.
namespace wagonsight {

// The light of an instant. Irradiances are relative to a bright day's.
struct WagonLight {
  float lamps = 0, day = 0, sun = 0;
  float outside = 0;                // how bright it is beyond the windows
  Eigen::Vector3f to_sun{0, 0, 1};  // unit vector in W
  double seconds = 0;               // since the scene began
  // The sun's place changes in steps of half a second; views that depend on it alone are
  // kept as long as it is the same.
  std::int64_t sun_step = -1;
};

// What [[light]] says of a time, with the ramps of a train's speed: half a second from one state to
// the next. While the sun shines its direction swings by 12 degrees, as the line bends.
WagonLight light_of(const Scene& scene, double seconds);

// The light that falls on a surface of unit normal `n_W` from lamps and sky; not the sun's.
inline float diffuse_light(const WagonLight& light, const Eigen::Vector3f& n_W) {
  return light.lamps * (0.6F + 0.4F * n_W.z()) + light.day * (0.6F + 0.4F * std::abs(n_W.y()));
}

// Which points the sun reaches: through a pane, and nothing else is in its way.
class SunPatches {
 public:
  explicit SunPatches(const std::vector<SceneBox>& windows);

  // For the light of an instant; does not allocate.
  void set(const WagonLight& light);
  bool shining() const { return shining_; }
  bool lit(const Eigen::Vector3f& p_W) const {
    for (const Pane& pane : panes_) {
      const float t = (pane.plane - p_W[pane.axis]) * pane.step;
      if (t < 0.01F) continue;
      const float a = p_W[pane.first] + t * to_sun_[pane.first];
      const float b = p_W[pane.second] + t * to_sun_[pane.second];
      if (a > pane.low[0] && a < pane.high[0] && b > pane.low[1] && b < pane.high[1]) return true;
    }
    return false;
  }

 private:
  struct Pane {
    int axis = 1, first = 0, second = 2;  // its normal's axis, and the two along it
    float plane = 0, step = 0;            // step: 1 over the sun's component along the axis, or 0
    float low[2]{}, high[2]{};
  };
  std::vector<Pane> panes_;
  Eigen::Vector3f to_sun_{0, 0, 1};
  bool shining_ = false;
};

}  // namespace wagonsight
