#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "simulate/raster.h"
#include "simulate/room.h"
#include "simulate/scene.h"

// How much of its own pattern a Kinect gets back from a surface, and what the still wagon looks
// like to it. The score of a pixel says how sure its reading is: a reading exists when the score is
// greater than a normal random number.
namespace wagonsight {

// Disparity of a Kinect in its own steps of 1/8 pixel: level = kLevels / z.
inline constexpr float kLevels = 580.0F * 0.075F * 8.0F;
inline constexpr float kNoReading = -20.0F;  // a score nothing can lift

// Score of a surface of `albedo` seen at inverse depth w (1/m) under the cosine `incidence`.
// Calibrated against a recording; see README.
inline float surface_score(float albedo, float incidence, float w) {
  const float c = std::max(incidence, 0.005F);
  const float signal = albedo / 0.45F * c * (9.0F * w * w);
  return 5.8F + 0.8F * std::log2(signal + 1e-9F) - 0.05F / c;
}

// What the speckle luck of a pixel adds to its score, at one standard deviation.
inline constexpr float kLuck = 0.7F;

// Where the image was: a working image has a margin on every side, so that looking a few pixels
// aside needs no test.
inline constexpr int kMargin = 4;

// The still wagon as one sensor sees it under one light.
struct StillView {
  std::vector<float> inverse_depth;  // 0: nothing
  std::vector<float> score;
};

// The optics of one Kinect of a scene.
class KinectOptics {
 public:
  // Allocates; for start-up, takes some hundred milliseconds.
  KinectOptics(const Scene& scene, std::size_t sensor, std::uint64_t seed);

  // The still view under a light with the sensor's pose X_WS (it may have been moved).
  StillView still_view(const Rigid& X_WS, const SceneLight& light) const;

  // What other projectors do to a surface at p_W, `distance2` (square metres) from the sensor: the
  // sum of their light over the sensor's own. Only counted where they reach; they are blocked by
  // furniture, not by passengers.
  float foreign_light(const Eigen::Vector3d& p_W, double distance2) const;
  // Whether the sun shines on p_W through a window.
  bool sunlit(const Eigen::Vector3d& p_W, const SceneLight& light) const;
  // Fixed speckle luck of each pixel: mean 0, variance 1, alike in neighbours.
  const std::vector<float>& luck() const { return luck_; }
  // What foreign light takes from a score where the luck is bad.
  static float foreign_penalty(float foreign, float luck) {
    const float share = foreign / (1.0F + foreign);
    return share * (0.6F + 3.0F * std::max(0.0F, -luck - 1.8F));
  }

  const Raster& raster() const { return raster_; }
  const Rigid& X_WS() const { return X_WS_; }

 private:
  struct OtherProjector {
    Rigid X_SW;
    std::vector<float> inverse_depth;  // what its own camera sees of the still wagon
  };
  // What the pane's pixel reads: a reflection, an error, or nothing.
  void read_pane(const PreparedPart& part, Material material, const SceneLight& light,
                 const Rigid& X_WS, int u, int v, float& w, float& score) const;

  const Scene* scene_;
  std::vector<RoomPart> room_;
  Raster raster_;
  Rigid X_WS_;
  std::uint64_t seed_;
  std::vector<OtherProjector> others_;
  std::vector<float> luck_;
};

// Takes the reading from every pixel that the projector, kKinectBaseline to the right, cannot
// reach: going from right to left its column u - f b w only ever moves left, unless something
// nearer stood in the way. Rows [v_begin, v_end) of images of `stride` floats a row.
void cast_projector_shadow(const float* inverse_depth, float* score, int width, int stride,
                           int v_begin, int v_end);

}  // namespace wagonsight
