#include "simulate/body.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace wagonsight {
namespace {

using Eigen::AngleAxisd;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;

// Where the joints are, in the body's own frame: x forwards, y left, z up, floor at 0.
struct Skeleton {
  Vector3d pelvis, waist, neck, head;
  std::array<Vector3d, 2> shoulder, elbow, hand, hip, knee, ankle;  // left, right
  Matrix3d torso;                                                   // orientation of the torso
};

struct Lengths {
  double thigh, shank, ankle, torso, neck, head, upper_arm, forearm, shoulder_half, hip_half;
};

Lengths lengths_of(const Figure& figure) {
  const double h = figure.height;
  // A child's head is larger and its legs are shorter, relative to its height.
  const double legs = figure.child ? 0.93 : 1.0;
  Lengths l{};
  l.thigh = 0.245 * h * legs;
  l.shank = 0.246 * h * legs;
  l.ankle = 0.039 * h;
  l.head = (figure.child ? 0.165 : 0.130) * h;
  l.neck = 0.045 * h;
  l.torso = h - l.head - l.neck - l.thigh - l.shank - l.ankle;
  l.upper_arm = 0.186 * h;
  l.forearm = 0.17 * h;
  l.shoulder_half = 0.112 * h * figure.girth;
  l.hip_half = 0.052 * h * figure.girth;
  return l;
}

// The joint between two links of lengths a and b from `from` to `to`, bent towards `pole`.
Vector3d bend(const Vector3d& from, Vector3d& to, double a, double b, const Vector3d& pole) {
  Vector3d along = to - from;
  const double reach = std::min(along.norm(), 0.9995 * (a + b));
  along.normalize();
  to = from + along * reach;
  const double x = (a * a - b * b + reach * reach) / (2 * reach);
  const double side = std::sqrt(std::max(a * a - x * x, 0.0));
  const Vector3d outward = (pole - along * pole.dot(along)).normalized();
  return from + along * x + outward * side;
}

void place_legs(const Lengths& l, const Pose& pose, Skeleton& s) {
  for (std::size_t i = 0; i < 2; ++i) {
    const double side = i == 0 ? 1 : -1;
    s.hip[i] = s.pelvis + Vector3d(0, side * l.hip_half, -0.01);
    // Half a turn the foot is on the floor and goes back under the body, half a turn it swings.
    const double turn = std::remainder(pose.gait_phase + (i == 0 ? 0 : kPi), 2 * kPi) / kPi;
    const bool swings = turn > 0;
    const double forward = swings ? -std::cos(turn * kPi) : -(1 + 2 * turn);
    const double lift = swings ? 0.35 * pose.step * std::sin(turn * kPi) : 0;
    Vector3d ankle(0.5 * pose.step * forward, side * l.hip_half * 1.1, l.ankle + lift);
    // Sitting, the shanks hang from the knees; a child's feet need not reach the floor.
    ankle.x() += pose.sit * 0.95 * l.thigh;
    ankle.z() = std::max(ankle.z(), pose.sit * (s.hip[i].z() - 0.95 * l.shank));
    s.knee[i] = bend(s.hip[i], ankle, l.thigh, l.shank, Vector3d(1, 0.1 * side, 0.3 * pose.sit));
    s.ankle[i] = ankle;
  }
}

void place_arms(const Lengths& l, const Pose& pose, Skeleton& s) {
  const double reach = l.upper_arm + l.forearm;
  for (std::size_t i = 0; i < 2; ++i) {
    const double side = i == 0 ? 1 : -1;
    const double swing =
        0.55 * pose.step * std::sin(pose.gait_phase + (i == 0 ? kPi : 0) + kPi / 2);
    Vector3d hand = s.shoulder[i] + s.torso * Vector3d(0.05 + swing, side * 0.04, -0.96 * reach);
    if (pose.sit > 0) {  // hands rest on the thighs
      const Vector3d lap = s.hip[i] + 0.6 * (s.knee[i] - s.hip[i]) + Vector3d(0, 0, 0.09);
      hand += pose.sit * (lap - hand);
    }
    if (pose.pram) hand = s.pelvis + Vector3d(0.38, side * 0.18, 0.12);
    if (pose.crouch > 0 && i == 1) hand += pose.crouch * (Vector3d(0.35, -0.15, 0.25) - hand);
    s.elbow[i] = bend(s.shoulder[i], hand, l.upper_arm, l.forearm, s.torso * Vector3d(-1, side, 0));
    s.hand[i] = hand;
  }
}

Skeleton skeleton_of(const Lengths& l, const Pose& pose) {
  Skeleton s;
  const double legs = l.thigh + l.shank;
  // At the wide moment of a step the hip sinks by the arc of the legs.
  const double sunk = pose.step * pose.step / (8 * legs) + 0.004;
  const double standing = l.ankle + legs - sunk - 0.45 * pose.crouch * legs;
  const double hip_radius = 0.5 * l.hip_half + 0.06;
  const double sitting = pose.support + hip_radius;
  s.pelvis = {0, 0, standing + pose.sit * (sitting - standing)};
  const double rising = std::sin(kPi * std::clamp(pose.sit, 0.0, 1.0));
  const double pitch = 0.6 * rising - 0.12 * pose.sit + 0.75 * pose.crouch + pose.lean_x +
                       0.04 * (pose.step > 0.1 ? 1 : 0);
  s.torso = (AngleAxisd(-pose.lean_y, Vector3d::UnitX()) * AngleAxisd(pitch, Vector3d::UnitY()))
                .toRotationMatrix();
  s.waist = s.pelvis + s.torso * Vector3d(0, 0, 0.25 * l.torso);
  s.neck = s.pelvis + s.torso * Vector3d(0, 0, l.torso);
  // The head is held more upright than the torso.
  const Matrix3d head_tilt = (AngleAxisd(-0.6 * pose.lean_y, Vector3d::UnitX()) *
                              AngleAxisd(0.5 * pitch, Vector3d::UnitY()))
                                 .toRotationMatrix();
  s.head = s.neck + head_tilt * Vector3d(0.01, 0, l.neck + 0.5 * l.head);
  for (std::size_t i = 0; i < 2; ++i)
    s.shoulder[i] =
        s.neck + s.torso * Vector3d(0, (i == 0 ? 1 : -1) * l.shoulder_half * 0.8, -0.02);
  place_legs(l, pose, s);
  place_arms(l, pose, s);
  return s;
}

// From the body's own frame to W. Lying, the upright body is turned down about its feet.
struct Placement {
  Matrix3d rotation;
  Vector3d position;

  Vector3d operator*(const Vector3d& p) const { return rotation * p + position; }
};

Placement placement_of(const Figure& figure, const Pose& pose) {
  const Matrix3d yaw = AngleAxisd(pose.yaw, Vector3d::UnitZ()).toRotationMatrix();
  Placement placement{yaw, {pose.x, pose.y, 0}};
  if (pose.recline <= 0) return placement;
  const Vector3d axis(-std::sin(pose.recline_yaw), std::cos(pose.recline_yaw), 0);
  placement.rotation = AngleAxisd(pose.recline * 0.5 * kPi, axis).toRotationMatrix() * yaw;
  // Flat on the floor the body's middle is half its thickness high, on its side half its width.
  const double turn = pose.recline_yaw - pose.yaw;
  const double thickness =
      figure.height * figure.girth * std::hypot(0.078 * std::cos(turn), 0.14 * std::sin(turn));
  placement.position.z() = pose.recline * (thickness + pose.support);
  return placement;
}

class Cladding {
 public:
  Cladding(const Placement& placement, std::int32_t tag, Parts& parts)
      : placement_(placement), tag_(tag), parts_(parts) {}

  void ellipsoid(const Vector3d& centre, const Matrix3d& axes, const Vector3d& half, float albedo) {
    add({Part::Shape::kEllipsoid, centre, axes, half, 0, albedo, tag_});
  }
  void ball(const Vector3d& centre, double radius, float albedo) {
    ellipsoid(centre, Matrix3d::Identity(), Vector3d::Constant(radius), albedo);
  }
  // A frustum between two points; `flat` scales its depth (second radius) relative to its width.
  void limb(const Vector3d& from, const Vector3d& to, double radius_from, double radius_to,
            float albedo, const Vector3d& wide = Vector3d::UnitY(), double flat = 1) {
    const Vector3d along = to - from;
    const double length = along.norm();
    if (length < 1e-4) return;
    Matrix3d axes;
    axes.col(2) = along / length;
    axes.col(1) = axes.col(2).cross(wide);
    if (axes.col(1).norm() < 1e-3) axes.col(1) = axes.col(2).cross(Vector3d::UnitX());
    axes.col(1).normalize();
    axes.col(0) = axes.col(1).cross(axes.col(2));
    const double radius = 0.5 * (radius_from + radius_to);
    const double taper = (radius_to - radius_from) / (2 * radius);
    add({Part::Shape::kCone,
         0.5 * (from + to),
         axes,
         {radius, radius * flat, 0.5 * length},
         taper,
         albedo,
         tag_});
  }
  void box(const Vector3d& centre, const Vector3d& half, float albedo) {
    add({Part::Shape::kBox, centre, Matrix3d::Identity(), half, 0, albedo, tag_});
  }

 private:
  void add(Part part) {
    part.centre = placement_ * part.centre;
    part.axes = placement_.rotation * part.axes;
    parts_.push_back(part);
  }

  Placement placement_;
  std::int32_t tag_;
  Parts& parts_;
};

constexpr float kSkin = 0.45F, kShoes = 0.12F, kBagAlbedo = 0.3F, kPramAlbedo = 0.25F;

void clad_torso(const Figure& figure, const Lengths& l, const Skeleton& s, Cladding& cladding) {
  const double h = figure.height, wide = figure.girth;
  const Vector3d left = s.torso.col(1);
  const double chest = 0.096 * h * wide, waist = 0.083 * h * wide;
  cladding.ellipsoid(s.pelvis + Vector3d(0, 0, 0.01 * h), s.torso,
                     {0.068 * h * wide, 0.098 * h * wide, 0.072 * h}, figure.trousers);
  const Vector3d chest_top = s.neck - s.torso.col(2) * 0.06 * h;
  cladding.limb(s.pelvis, chest_top, waist, chest, figure.clothes, left, 0.68);
  cladding.ellipsoid(chest_top, s.torso, {0.066 * h * wide, l.shoulder_half, 0.058 * h},
                     figure.clothes);
  cladding.limb(chest_top, s.head, 0.036 * h, 0.032 * h, kSkin);
  cladding.ellipsoid(s.head, s.torso, {0.057 * h, 0.045 * h, 0.5 * l.head}, figure.hair);
  if (!figure.coat) return;
  const Vector3d hem_middle =
      0.5 * (s.knee[0] + s.knee[1]) * 0.55 + 0.5 * (s.hip[0] + s.hip[1]) * 0.45;
  cladding.limb(s.pelvis, chest_top, 1.22 * waist, 1.16 * chest, figure.clothes, left, 0.75);
  cladding.limb(hem_middle, s.pelvis, 1.35 * waist, 1.22 * waist, figure.clothes, left, 0.8);
}

}  // namespace

Pose interpolate(const Pose& a, const Pose& b, double share) {
  if (a.present != b.present) return b;
  Pose pose = share < 0.5 ? a : b;
  const auto mix = [share](double from, double to) { return from + share * (to - from); };
  pose.x = mix(a.x, b.x);
  pose.y = mix(a.y, b.y);
  pose.yaw = mix(a.yaw, b.yaw);
  pose.gait_phase = mix(a.gait_phase, b.gait_phase);
  pose.step = mix(a.step, b.step);
  pose.crouch = mix(a.crouch, b.crouch);
  pose.sit = mix(a.sit, b.sit);
  pose.support = mix(a.support, b.support);
  pose.lean_x = mix(a.lean_x, b.lean_x);
  pose.lean_y = mix(a.lean_y, b.lean_y);
  pose.recline = mix(a.recline, b.recline);
  return pose;
}

void clad(const Figure& figure, const Pose& pose, std::int32_t tag, Parts& parts) {
  const Lengths l = lengths_of(figure);
  const Skeleton s = skeleton_of(l, pose);
  Cladding cladding(placement_of(figure, pose), tag, parts);
  const double h = figure.height, wide = std::sqrt(figure.girth);
  const double sleeve = figure.coat ? 1.3 : 1.0;
  clad_torso(figure, l, s, cladding);
  for (std::size_t i = 0; i < 2; ++i) {
    const double arm = 0.029 * h * wide * sleeve;
    cladding.ball(s.shoulder[i], 1.15 * arm, figure.clothes);
    cladding.limb(s.shoulder[i], s.elbow[i], 1.1 * arm, 0.85 * arm, figure.clothes);
    cladding.ball(s.elbow[i], 0.86 * arm, figure.clothes);
    cladding.limb(s.elbow[i], s.hand[i], 0.85 * arm, 0.6 * arm, figure.clothes);
    cladding.ball(s.hand[i], 0.026 * h, kSkin);
    const double thigh = 0.05 * h * wide;
    cladding.limb(s.hip[i], s.knee[i], thigh, 0.68 * thigh, figure.trousers);
    cladding.ball(s.hip[i], thigh, figure.trousers);
    cladding.ball(s.knee[i], 0.69 * thigh, figure.trousers);
    cladding.limb(s.knee[i], s.ankle[i], 0.68 * thigh, 0.45 * thigh, figure.trousers);
    // Lying, the feet hang down along the shanks.
    const Matrix3d foot =
        AngleAxisd(0.45 * kPi * pose.recline, Vector3d::UnitY()).toRotationMatrix();
    cladding.ellipsoid(s.ankle[i] + foot * Vector3d(0.04 * h, 0, 0.022 * h - l.ankle), foot,
                       {0.077 * h, 0.028 * h, 0.022 * h}, kShoes);
  }
}

void place_bag(const Eigen::Vector2d& position, double yaw, std::int32_t tag, Parts& parts) {
  const Placement placement{AngleAxisd(yaw, Vector3d::UnitZ()).toRotationMatrix(),
                            {position.x(), position.y(), 0}};
  Cladding cladding(placement, tag, parts);
  cladding.box({0, 0, 0.15}, {0.22, 0.12, 0.15}, kBagAlbedo);
  cladding.ellipsoid({0, 0, 0.29}, Matrix3d::Identity(), {0.2, 0.11, 0.06}, kBagAlbedo);
}

void place_pram(const Eigen::Vector2d& position, double yaw, std::int32_t tag, Parts& parts) {
  const Placement placement{AngleAxisd(yaw, Vector3d::UnitZ()).toRotationMatrix(),
                            {position.x(), position.y(), 0}};
  Cladding cladding(placement, tag, parts);
  cladding.ellipsoid({0.02, 0, 0.62}, Matrix3d::Identity(), {0.38, 0.21, 0.22}, kPramAlbedo);
  cladding.ellipsoid({0.2, 0, 0.8}, Matrix3d::Identity(), {0.2, 0.21, 0.22}, kPramAlbedo);
  for (const double side : {-1.0, 1.0}) {
    for (const double end : {-1.0, 1.0})
      cladding.ellipsoid({0.3 * end, 0.24 * side, 0.13}, Matrix3d::Identity(), {0.13, 0.025, 0.13},
                         kShoes);
    cladding.limb({0.28, 0.2 * side, 0.15}, {-0.45, 0.2 * side, 0.98}, 0.015, 0.015, kPramAlbedo);
  }
  cladding.limb({-0.45, -0.2, 0.98}, {-0.45, 0.2, 0.98}, 0.018, 0.018, kPramAlbedo);
}

void clad_luggage(const Figure& figure, const Pose& pose, std::int32_t tag, Parts& parts) {
  if (pose.bag && pose.recline < 0.3) {
    const Skeleton s = skeleton_of(lengths_of(figure), pose);
    const Vector3d hand = placement_of(figure, pose) * s.hand[1];
    Cladding cladding({AngleAxisd(pose.yaw, Vector3d::UnitZ()).toRotationMatrix(),
                       {hand.x(), hand.y(), std::max(hand.z() - 0.36, 0.02)}},
                      -tag, parts);
    const Vector3d beside(0, pose.sit > 0.5 ? 0 : -0.1, 0);  // it clears the leg
    cladding.box(Vector3d(0, 0, 0.15) + beside, {0.22, 0.12, 0.15}, kBagAlbedo);
    cladding.ellipsoid(Vector3d(0, 0, 0.29) + beside, Matrix3d::Identity(), {0.2, 0.11, 0.06},
                       kBagAlbedo);
  }
  if (pose.pram) {
    const double ahead = 0.85 + 0.3 * pose.sit;  // its handle is in the passenger's hands
    place_pram({pose.x + ahead * std::cos(pose.yaw), pose.y + ahead * std::sin(pose.yaw)}, pose.yaw,
               -tag, parts);
  }
}

namespace {

// Half extent of a part along a unit direction.
double extent(const Part& part, const Vector3d& direction) {
  const Vector3d along = part.axes.transpose() * direction;
  if (part.shape == Part::Shape::kEllipsoid) return part.half.cwiseProduct(along).norm();
  const Vector3d reach = part.half.cwiseProduct(along);
  if (part.shape == Part::Shape::kBox) return reach.cwiseAbs().sum();
  return (1 + std::abs(part.taper)) * reach.head<2>().norm() + std::abs(reach.z());
}

Box box_around(const Parts& parts, double yaw) {
  Matrix3d axes = AngleAxisd(yaw, Vector3d::UnitZ()).toRotationMatrix();
  Vector3d low = Vector3d::Constant(1e9), high = -low;
  for (const Part& part : parts) {
    for (int i = 0; i < 3; ++i) {
      const double middle = axes.col(i).dot(part.centre), half = extent(part, axes.col(i));
      low[i] = std::min(low[i], middle - half);
      high[i] = std::max(high[i], middle + half);
    }
  }
  const Vector3d centre = axes * (0.5 * (low + high));
  Box box;
  for (std::size_t i = 0; i < 3; ++i) {
    box.center[i] = centre[static_cast<int>(i)];
    box.size[i] = high[static_cast<int>(i)] - low[static_cast<int>(i)];
  }
  box.yaw = yaw;
  return box;
}

// The ellipsoid with the body's own volume moments: a solid one has the covariance a^2 / 5.
Ellipsoid ellipsoid_of(const Parts& parts) {
  double volume = 0;
  Vector3d mean = Vector3d::Zero();
  Matrix3d second = Matrix3d::Zero();
  for (const Part& part : parts) {
    const bool round = part.shape == Part::Shape::kEllipsoid;
    const double v = part.half.prod() * (round ? 4.0 / 3.0 : 2.0) * kPi;
    const Vector3d spread =
        round ? Vector3d(part.half.array().square() / 5)
              : Vector3d(part.half.array().square() * Eigen::Array3d(0.25, 0.25, 1.0 / 3.0));
    volume += v;
    mean += v * part.centre;
    second += v * (part.axes * spread.asDiagonal() * part.axes.transpose() +
                   part.centre * part.centre.transpose());
  }
  mean /= volume;
  const Matrix3d covariance = second / volume - mean * mean.transpose();
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(covariance);  // ascending
  Matrix3d axes;
  Ellipsoid ellipsoid;
  for (int i = 0; i < 3; ++i) {
    axes.col(i) = solver.eigenvectors().col(2 - i);
    ellipsoid.semi_axes[static_cast<std::size_t>(i)] =
        std::sqrt(5 * std::max(solver.eigenvalues()[2 - i], 0.0));
    ellipsoid.center[static_cast<std::size_t>(i)] = mean[i];
  }
  if (axes.determinant() < 0) axes.col(2) = -axes.col(2);
  const Eigen::Quaterniond q(axes);
  ellipsoid.rotation = {q.w(), q.x(), q.y(), q.z()};
  return ellipsoid;
}

std::array<double, 3> as_array(const Vector3d& p) {
  return {p.x(), p.y(), p.z()};
}

}  // namespace

Person describe(const Figure& figure, const Pose& pose, const Parts& parts) {
  const Skeleton s = skeleton_of(lengths_of(figure), pose);
  const Placement placement = placement_of(figure, pose);
  const Vector3d torso = placement * Vector3d(0.5 * (s.pelvis + s.neck));
  Person person;
  person.position = {torso.x(), torso.y()};
  person.height = figure.height;
  person.posture = Posture::kStanding;
  if (pose.sit > 0.5) person.posture = Posture::kSitting;
  if (pose.recline > 0.5) person.posture = Posture::kLying;
  const double yaw = pose.recline > 0.5 ? pose.recline_yaw : pose.yaw;
  person.box = box_around(parts, std::remainder(yaw, 2 * kPi));
  person.ellipsoid = ellipsoid_of(parts);
  person.has_head = person.has_shoulders = true;
  person.head = as_array(placement * s.head);
  person.shoulder_left = as_array(placement * s.shoulder[0]);
  person.shoulder_right = as_array(placement * s.shoulder[1]);
  return person;
}

}  // namespace wagonsight
