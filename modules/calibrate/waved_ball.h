#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "frame/image.h"
#include "rig/ray_table.h"
#include "rig/rig.h"

namespace wagonsight {

// Where one depth image shows a ball of known size.
struct BallSighting {
  Eigen::Vector3d p_S = Eigen::Vector3d::Zero();  // its centre, metres
  int readings = 0;
};

// Finds a ball that is waved before a sensor: among what stands before the still background, the
// place where a sphere of its radius explains most readings of its disc and where least of the same
// distance goes on beside it (an arm, a head on its neck). Then the sphere is fitted to the
// readings along their rays. One sensor each; not for the data path: it allocates.
class WavedBall {
 public:
  // `rays` one a pixel of the sensor's camera; they must outlive this.
  WavedBall(const RigSensor& sensor, RayTable rays, double radius_m);

  // Images from all over the recording, a dozen or two: what is seen in most of them is still. Call
  // finish_learning() after them and before find().
  void learn(const DepthImage& image);
  void finish_learning();

  std::optional<BallSighting> find(const DepthImage& image);

 private:
  struct Score {
    double share = 0;   // of the disc's pixels that the sphere explains
    double beside = 1;  // of the ring's around it that go on at its distance
  };
  struct Reading {
    Eigen::Vector3d ray;  // (x, y, 1)
    double z;
  };

  // Metres along the optical axis; 0: no reading, beyond the trims or of the background.
  void take_foreground(const DepthImage& image);
  Eigen::Vector3d ray(std::size_t pixel) const;
  double tolerance(double z) const;
  Score score(const Eigen::Vector3d& centre) const;
  std::vector<Reading> readings_on(const Eigen::Vector3d& centre) const;
  bool refine(Eigen::Vector3d& centre, int& readings) const;
  template <class Visit>
  void for_disc(const Eigen::Vector3d& centre, double reach, int steps, const Visit& visit) const;

  RigSensor sensor_;
  RayTable rays_;
  double radius_m_;
  std::vector<std::vector<std::uint16_t>> seen_;
  std::vector<std::uint16_t> still_;  // raw depth; 0: unknown
  std::vector<float> front_;          // of the image in work
};

}  // namespace wagonsight
