#pragma once

#include "base/fixed_vector.h"
#include "simulate/part.h"
#include "simulate/scene.h"
#include "snapshot/snapshot.h"

// The simulator's articulated figure: a skeleton whose proportions follow Drillis and Contini
// (1966), clad with ellipsoids and tapered limbs. Only the simulator knows it; nothing that
// detects people may.
namespace wagonsight {

// How a passenger is built and dressed, drawn once from the seed.
struct Figure {
  double height = 1.74;
  bool child = false;
  double girth = 1;  // widths relative to the average
  float hair = 0.3F, clothes = 0.4F, trousers = 0.3F;
  bool coat = false;
};

// Everything that moves, as numbers that may be interpolated between two instants. Positions in W.
struct Pose {
  double x = 0, y = 0;     // of the pelvis (standing, sitting) or of the feet (fallen, lying)
  double yaw = 0;          // the way the body faces; continuous, not folded
  double gait_phase = 0;   // radians, a full turn is two steps; continuous
  double step = 0;         // length of a step, metres; 0 stands still
  double crouch = 0;       // 0..1: bent down to the floor
  double sit = 0;          // 0 standing .. 1 sitting
  double support = 0;      // height of what is sat or lain on, metres
  double lean_x = 0;       // torso's tilt forwards and to the left, radians
  double lean_y = 0;       //
  double recline = 0;      // 0 upright .. 1 lying
  double recline_yaw = 0;  // the way the head goes, in W
  bool present = false;    // exists at all
  bool bag = false, pram = false;  // carried now
};

Pose interpolate(const Pose& a, const Pose& b, double share);

inline constexpr std::size_t kPartsPerFigure = 40;
using Parts = FixedVector<Part, kPartsPerFigure>;

// A figure in a pose as solids in W, each tagged with `tag`. Does not allocate.
void clad(const Figure& figure, const Pose& pose, std::int32_t tag, Parts& parts);

// What the passenger carries in this pose, tagged with -tag.
void clad_luggage(const Figure& figure, const Pose& pose, std::int32_t tag, Parts& parts);
// A bag or a pram that stands alone at a place on the floor.
void place_bag(const Eigen::Vector2d& position, double yaw, std::int32_t tag, Parts& parts);
void place_pram(const Eigen::Vector2d& position, double yaw, std::int32_t tag, Parts& parts);

// The exact truth of a figure in a pose: position, height, posture, box, ellipsoid, head and
// shoulders. Id and velocity are the caller's.
Person describe(const Figure& figure, const Pose& pose, const Parts& parts);

}  // namespace wagonsight
