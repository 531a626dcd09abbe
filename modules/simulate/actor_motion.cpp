// How an Actor moves: the motions that acts are broken down into.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "simulate/actor.h"
#include "simulate/random.h"

namespace wagonsight {
namespace {

using Eigen::Vector2d;

constexpr double kPi = std::numbers::pi;

Vector2d direction_of(double yaw) {
  return {std::cos(yaw), std::sin(yaw)};
}
double yaw_of(const Vector2d& direction) {
  return std::atan2(direction.y(), direction.x());
}

}  // namespace

double Actor::eased(double dt, double seconds) {
  progress_ = std::min(1.0, progress_ + dt / std::max(seconds, 0.01));
  return progress_ * progress_ * (3 - 2 * progress_);
}

bool Actor::turn_towards(double yaw, double rate, double dt) {
  const double error = std::remainder(yaw - pose_.yaw, 2 * kPi);
  const double turn = std::clamp(error, -rate * dt, rate * dt);
  pose_.yaw += turn;
  return std::abs(error - turn) < 0.05;
}

// Steers around others who are near and ahead, keeping right when in doubt; `pace` 0..1 is what is
// left of the speed.
Vector2d Actor::evade(const Vector2d& direction, double& pace, const Surroundings& stage) const {
  const Vector2d right(direction.y(), -direction.x());
  double push = 0;
  for (std::size_t i = 0; i < stage.neighbours.size(); ++i) {
    const Neighbour& other = stage.neighbours[i];
    if (i == index_ || !other.present) continue;
    const Vector2d gap = other.position - at();
    const double distance = gap.norm(), ahead = gap.dot(direction), aside = gap.dot(right);
    constexpr double kNotice = 1.2, kShoulders = 0.45, kStop = 0.45, kSlow = 0.85;
    if (distance > kNotice || ahead < -0.1) continue;
    const double away = aside > -0.05 && aside < 0.05 ? 1 : (aside < 0 ? 1 : -1);
    push += away * (1 - distance / kNotice) * (std::abs(aside) < 0.6 ? 1.6 : 0.4);
    if (ahead > 0 && std::abs(aside) < kShoulders)
      pace = std::min(pace, std::clamp((distance - kStop) / (kSlow - kStop), 0.0, 1.0));
  }
  const Vector2d steered = direction + std::clamp(push, -1.2, 1.2) * right;
  const Vector2d next = at() + 0.25 * steered.normalized();
  // Nobody steps into the furniture to make room.
  if (!outside_ && stage.plan->walkable(at()) && !stage.plan->walkable(next)) return direction;
  return steered.normalized();
}

bool Actor::step_towards(const Vector2d& to, double dt, bool last, bool evades,
                         const Surroundings& stage) {
  const Vector2d gap = to - at();
  const double distance = gap.norm();
  const double near = last ? 0.02 : 0.18;
  if (distance < near) return true;
  Vector2d direction = gap / distance;
  double pace = 1;
  squeeze_ = std::max(0.0, squeeze_ - dt);
  if (evades && squeeze_ <= 0 && distance > 0.25) {
    direction = evade(direction, pace, stage);
    patience_ = pace < 0.3 ? patience_ + dt : std::max(0.0, patience_ - dt);
    const double limit = 1.2 + 1.5 * uniform(mixed(seed_, 12));
    if (patience_ > limit) patience_ = 0, squeeze_ = 1.2;
  }
  const double wanted_yaw = yaw_of(direction);
  const double error = std::abs(std::remainder(wanted_yaw - pose_.yaw, 2 * kPi));
  turn_towards(wanted_yaw, 4.5, dt);
  const double turning = std::clamp(1.4 - error, 0.15, 1.0);
  const double braking = last ? std::sqrt(2 * 1.2 * distance) + 0.05 : cruise_;
  const double target = std::min(cruise_ * pace * turning, braking);
  speed_ += std::clamp(target - speed_, -4.0 * dt, 1.8 * dt);
  speed_ = std::max(speed_, 0.0);
  const double advance = std::min(speed_ * dt, distance);
  pose_.x += direction.x() * advance;
  pose_.y += direction.y() * advance;
  // A longer stride comes with speed; the feet stand still on the floor while they carry.
  const double stride =
      std::clamp(0.42 * figure_.height * std::sqrt(speed_ / 1.3), 0.0, 0.62 * figure_.height);
  pose_.step += std::clamp(stride - pose_.step, -1.5 * dt, 1.5 * dt);
  if (pose_.step > 0.05) pose_.gait_phase += kPi * advance / pose_.step;
  return false;
}

bool Actor::follow(const Motion& motion, double dt, const Surroundings& stage) {
  if (!started_) {
    stage.plan->find_way(at(), motion.to, way_);
    waypoint_ = 0;
    started_ = true;
    progress_ = 0;
  }
  // Held up for long near the goal, one stays where one is rather than push for ever.
  constexpr double kNearEnough = 0.7, kWaitMax = 6;
  if (speed_ < 0.15 && (motion.to - at()).norm() < kNearEnough) progress_ += dt;
  if (progress_ > kWaitMax) return true;
  const bool last = waypoint_ + 1 == way_.size();
  if (step_towards(way_[waypoint_], dt, last, true, stage)) ++waypoint_;
  return waypoint_ >= way_.size();
}

bool Actor::sit_down(const Motion& motion, double dt, const Surroundings& stage) {
  const SceneSeat& seat = stage.scene->seats[static_cast<std::size_t>(motion.index)];
  seat_ = motion.index;
  const double share = eased(dt, motion.value);
  const Vector2d to = seat.position - kSeatBack * direction_of(seat.yaw);
  pose_.x = from_.x + share * (to.x() - from_.x);
  pose_.y = from_.y + share * (to.y() - from_.y);
  pose_.support = kSeatHeight;
  pose_.sit = share;
  pose_.step = from_.step * (1 - share);
  return progress_ >= 1;
}

double Actor::clear_fall_direction(double wanted, const Surroundings& stage) const {
  // Of sixteen directions the one nearest to the wanted one in which the body finds room.
  const double length = 0.95 * figure_.height;
  for (int i = 0; i < 16; ++i) {
    const int eighths = (i + 1) / 2;  // 0, 1, 1, 2, 2, ... to both sides in turn
    const double turn = (i % 2 == 0 ? 1 : -1) * eighths * (kPi / 8);
    const double yaw = wanted + turn;
    const Vector2d end = at() + length * direction_of(yaw);
    if (stage.plan->walkable(end) && stage.plan->straight(at(), end, 0.15)) return yaw;
  }
  return wanted;
}

bool Actor::recline(const Motion& motion, double seconds, double dt, const Surroundings& stage) {
  const bool falls = motion.kind == MotionKind::kFall;
  if (progress_ <= 0) {
    double wanted = pose_.yaw;
    if (falls && motion.index >= 0 && (motion.to - at()).norm() > 0.05)
      wanted = yaw_of(motion.to - at());
    pose_.recline_yaw = clear_fall_direction(wanted, stage);
    if (!falls && motion.index >= 0) {  // along the seat, the head to the side with more room
      const SceneSeat& seat = stage.scene->seats[static_cast<std::size_t>(motion.index)];
      seat_ = motion.index;
      const Vector2d along = direction_of(seat.yaw + 0.5 * kPi);
      const double room = stage.plan->clearance(seat.position + along) -
                          stage.plan->clearance(seat.position - along);
      pose_.recline_yaw = seat.yaw + (room >= 0 ? 0.5 : -0.5) * kPi;
    }
  }
  double share = eased(dt, seconds);
  if (falls) share = progress_ * progress_;  // as things fall
  pose_.recline = share;
  pose_.crouch = (falls ? 0.5 : 0.9) * std::sin(kPi * share);
  pose_.sit = from_.sit * (1 - share);
  pose_.step = from_.step * (1 - share);
  pose_.lean_x = from_.lean_x * (1 - share);
  pose_.lean_y = from_.lean_y * (1 - share);
  Vector2d feet(from_.x, from_.y);
  pose_.support = from_.support * (1 - share);
  if (motion.index >= 0 && !falls) {
    const SceneSeat& seat = stage.scene->seats[static_cast<std::size_t>(motion.index)];
    const Vector2d rest = seat.position - 0.5 * figure_.height * direction_of(pose_.recline_yaw);
    feet += share * (rest - feet);
    pose_.support = share * kSeatHeight;
  } else if (!falls) {  // one lies down where one stood: the middle of the body stays
    feet -= share * 0.5 * figure_.height * direction_of(pose_.recline_yaw);
  }
  pose_.x = feet.x(), pose_.y = feet.y();
  speed_ = 0;
  return progress_ >= 1;
}

void Actor::handle_item(const Motion& motion, const Surroundings& stage) {
  if (motion.kind == MotionKind::kTake) {
    StandingItem& item = (*stage.items)[static_cast<std::size_t>(motion.index)];
    if (!item.there) return;  // somebody else was faster
    item.there = false;
    (item.pram ? pose_.pram : pose_.bag) = true;
    return;
  }
  const bool pram = motion.index == 1;
  bool& carried = pram ? pose_.pram : pose_.bag;
  if (!carried) return;
  // A place in the list that has become free is used again.
  StandingItems& items = *stage.items;
  std::size_t place = 0;
  while (place < items.size() && items[place].there) ++place;
  if (place == items.size() && !items.try_push_back({})) return;
  carried = false;
  StandingItem& item = items[place];
  const SceneAct& act = passenger_->acts[next_act_ - 1];
  item.name.assign(act.item);
  item.pram = pram;
  item.there = true;
  const double ahead = pram ? 0.85 + 0.3 * pose_.sit : 0.45;
  item.position = motion.value > 0 ? motion.to : Vector2d(at() + ahead * direction_of(pose_.yaw));
  item.position.x() = std::clamp(item.position.x(), 0.25, stage.scene->length - 0.25);
  item.position.y() = std::clamp(item.position.y(), 0.25, stage.scene->width - 0.25);
  item.yaw = pose_.yaw;
  item.owner = static_cast<std::int32_t>(index_);
}

// Standing up, rising and bending: what ends where it began, upright or bent.
bool Actor::settle(MotionKind kind, double seconds, double dt) {
  const double share = eased(dt, seconds), rest = 1 - share;
  switch (kind) {
    case MotionKind::kStandUp: {
      const Vector2d forward = direction_of(pose_.yaw) * (kSeatApproach + kSeatBack);
      pose_.x = from_.x + share * forward.x();
      pose_.y = from_.y + share * forward.y();
      pose_.sit = from_.sit * rest;
      pose_.lean_x = from_.lean_x * rest;
      pose_.lean_y = from_.lean_y * rest;
      break;
    }
    case MotionKind::kRise:
      pose_.recline = from_.recline * rest;
      pose_.crouch = 0.8 * std::sin(kPi * share);
      pose_.support = from_.support * rest;
      break;
    case MotionKind::kBend:
      pose_.crouch = share * (1 - 0.5 * pose_.sit);
      slow_down(dt);
      break;
    default:  // kStraighten
      pose_.crouch = from_.crouch * rest;
      break;
  }
  const bool ends = progress_ >= 1;
  if (ends && (kind == MotionKind::kStandUp || kind == MotionKind::kRise)) seat_ = -1;
  return ends;
}

bool Actor::lean(const Motion& motion, double dt) {
  const double share = eased(dt, motion.value);
  const double angle = motion.index < 0 ? 0 : 0.32;
  const Vector2d towards = motion.to - Vector2d(from_.x, from_.y);
  const double side = towards.norm() > 1e-6 ? yaw_of(towards) - pose_.yaw : 0;
  pose_.lean_x = from_.lean_x + share * (angle * std::cos(side) - from_.lean_x);
  pose_.lean_y = from_.lean_y + share * (angle * std::sin(side) - from_.lean_y);
  pose_.step = from_.step * (1 - share);
  return progress_ >= 1;
}

void Actor::appear(const Motion& motion) {
  pose_ = {};
  pose_.x = motion.to.x(), pose_.y = motion.to.y(), pose_.yaw = motion.value;
  pose_.bag = from_.bag, pose_.pram = from_.pram;
  pose_.present = true;
}

void Actor::slow_down(double dt) {
  speed_ = 0;
  pose_.step = std::max(0.0, pose_.step - 1.5 * dt);
}

void Actor::give_way(const Vector2d& shift, const Surroundings& stage) {
  const Vector2d to = at() + shift;
  if (outside_ || !stage.plan->walkable(to)) return;
  // Half way into a seat or to the floor nobody can be pushed.
  const MotionKind kind = motion_ < motions_.size() ? motions_[motion_].kind : MotionKind::kWait;
  if (kind != MotionKind::kWait && kind != MotionKind::kFollow && kind != MotionKind::kTurn) return;
  pose_.x = to.x(), pose_.y = to.y();
}

bool Actor::run(const Motion& motion, double dt, const Surroundings& stage) {
  if (motion.kind == MotionKind::kFollow) return follow(motion, dt, stage);
  if (!started_) {
    started_ = true;
    progress_ = 0;
    from_ = pose_;
  }
  switch (motion.kind) {
    case MotionKind::kAppear:
      appear(motion);
      return true;
    case MotionKind::kVanish:
      pose_.present = false;
      outside_ = true;
      return true;
    case MotionKind::kOpenDoor:
      door_in_use_ = motion.index;
      slow_down(dt);
      return eased(dt, motion.value) >= 1;
    case MotionKind::kWait:
      slow_down(dt);
      return eased(dt, motion.value) >= 1;
    case MotionKind::kStraight:
      if (!step_towards(motion.to, dt, false, true, stage)) return false;
      outside_ = false;
      return true;
    case MotionKind::kTurn:
      slow_down(dt);
      if (motion.index != kFaceThePlace) return turn_towards(motion.value, 3.5, dt);
      return turn_towards(yaw_of(motion.to - at()), 3.5, dt);
    case MotionKind::kSit:
      return sit_down(motion, dt, stage);
    case MotionKind::kLean:
      return lean(motion, dt);
    case MotionKind::kFall:
    case MotionKind::kLieDown:
      return recline(motion, motion.value, dt, stage);
    case MotionKind::kPut:
    case MotionKind::kTake:
      handle_item(motion, stage);
      return true;
    case MotionKind::kStandUp:
    case MotionKind::kRise:
    case MotionKind::kBend:
    case MotionKind::kStraighten:
      return settle(motion.kind, motion.value, dt);
    case MotionKind::kFollow:
      break;
  }
  return true;
}

}  // namespace wagonsight
