#include "simulate/actor.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "simulate/random.h"

namespace wagonsight {
namespace {

using Eigen::Vector2d;

constexpr double kPi = std::numbers::pi;

Vector2d direction_of(double yaw) {
  return {std::cos(yaw), std::sin(yaw)};
}

// What a scene puts down without having named it before was carried from the beginning.
bool puts_before_taking(const ScenePassenger& passenger, bool pram) {
  for (const SceneAct& act : passenger.acts) {
    if ((act.item == "pram") != pram) continue;
    if (act.kind == ActKind::kPut) return act.item != "coat";
    if (act.kind == ActKind::kTake) return false;
  }
  return false;
}

}  // namespace

Actor::Actor(const ScenePassenger& passenger, std::size_t index, const Surroundings& stage,
             std::uint64_t seed)
    : passenger_(&passenger), index_(index), seed_(mixed(seed, 0xAC70, index)) {
  figure_.height = passenger.height;
  figure_.child = passenger.build == BuildKind::kChild;
  figure_.girth = 0.92 + 0.2 * uniform(mixed(seed_, 1));
  figure_.clothes = static_cast<float>(0.22 + 0.4 * uniform(mixed(seed_, 2)));
  figure_.trousers = static_cast<float>(0.18 + 0.3 * uniform(mixed(seed_, 3)));
  figure_.hair = static_cast<float>(0.12 + 0.3 * uniform(mixed(seed_, 4)));
  figure_.coat = passenger.coat;
  if (figure_.coat) figure_.clothes = static_cast<float>(0.07 + 0.08 * uniform(mixed(seed_, 5)));
  cruise_ = (figure_.child ? 0.95 : 1.15) + 0.2 * uniform(mixed(seed_, 6));
  pose_.bag = passenger.bag || puts_before_taking(passenger, false);
  pose_.pram = passenger.pram || puts_before_taking(passenger, true);
  pose_.yaw = 2 * kPi * uniform(mixed(seed_, 7));
  const bool enters_first =
      !passenger.acts.empty() && passenger.acts.front().kind == ActKind::kEnter;
  outside_ = enters_first || (passenger.door >= 0 && !passenger.start && passenger.seat < 0);
  if (outside_) return;
  pose_.present = true;
  if (passenger.seat >= 0) {
    const SceneSeat& seat = stage.scene->seats[static_cast<std::size_t>(passenger.seat)];
    const Vector2d p = seat.position - kSeatBack * direction_of(seat.yaw);
    pose_.x = p.x(), pose_.y = p.y(), pose_.yaw = seat.yaw;
    pose_.sit = 1, pose_.support = kSeatHeight;
    seat_ = passenger.seat;
  } else if (passenger.start) {
    pose_.x = passenger.start->x(), pose_.y = passenger.start->y();
  }
}

Vector2d Actor::before_seat(const SceneSeat& seat) {
  return seat.position + kSeatApproach * direction_of(seat.yaw);
}

Neighbour Actor::as_neighbour() const {
  return {at(), pose_.present, pose_.sit < 0.5 && pose_.recline < 0.5, seat_};
}

void Actor::add(MotionKind kind, double value, int index, const Vector2d& to) {
  if (!motions_.full()) motions_.push_back({kind, to, value, index});
}

void Actor::walk_to(const Vector2d& to) {
  add(MotionKind::kFollow, 0, -1, to);
}

void Actor::get_up() {
  if (pose_.recline > 0)
    add(MotionKind::kRise, 2.5);
  else if (pose_.sit > 0)
    add(MotionKind::kStandUp, 1.2);
  else if (pose_.lean_x != 0 || pose_.lean_y != 0)
    add(MotionKind::kLean, 0.6);
}

int Actor::nearest_door(const Surroundings& stage) const {
  int best = -1;
  double least = 1e9;
  for (std::size_t i = 0; i < stage.doorways.size(); ++i) {
    const double d = (stage.doorways[i].middle - at()).norm();
    if (d < least) least = d, best = static_cast<int>(i);
  }
  return best;
}

int Actor::nearest_seat(const Vector2d& near, const Surroundings& stage) const {
  int best = -1;
  double least = 1e9;
  for (std::size_t i = 0; i < stage.scene->seats.size(); ++i) {
    const auto taken = [&](const Neighbour& other) {
      return other.present && other.seat == static_cast<int>(i);
    };
    const bool mine = seat_ == static_cast<int>(i);
    if (!mine && std::any_of(stage.neighbours.begin(), stage.neighbours.end(), taken)) continue;
    const double d = (stage.scene->seats[i].position - near).norm();
    if (d < least) least = d, best = static_cast<int>(i);
  }
  return best;
}

int Actor::find_item(const SceneAct& act, const Surroundings& stage) const {
  int best = -1;
  double least = 1e9;
  const Vector2d near = act.to.value_or(at());
  for (std::size_t i = 0; i < stage.items->size(); ++i) {
    const StandingItem& item = (*stage.items)[i];
    if (!item.there || item.pram != (act.item == "pram")) continue;
    // One's own and what bears the very name come first, wherever they are.
    const double d = (item.position - near).norm() -
                     (item.owner == static_cast<std::int32_t>(index_) ? 100 : 0) -
                     (item.name == std::string_view(act.item) ? 1000 : 0);
    if (d < least) least = d, best = static_cast<int>(i);
  }
  return best;
}

// Where an act leads to: a point, the place before a seat, or the inner side of a door.
Vector2d Actor::destination(const SceneAct& act, const Surroundings& stage) const {
  if (act.to) return *act.to;
  if (act.seat >= 0) return before_seat(stage.scene->seats[static_cast<std::size_t>(act.seat)]);
  if (act.door >= 0) {
    const Doorway& way = stage.doorways[static_cast<std::size_t>(act.door)];
    return way.middle + 0.6 * way.inward;
  }
  return at();
}

void Actor::begin_enter(const SceneAct& act, const Surroundings& stage) {
  int door = act.door >= 0 ? act.door : passenger_->door;
  if (door < 0) door = std::max(0, nearest_door(stage));
  const Doorway& way = stage.doorways[static_cast<std::size_t>(door)];
  const double room = std::max(0.0, 0.5 * way.width - 0.35);
  const double side = room * (2 * uniform(mixed(seed_, 8, next_act_)) - 1);
  const Vector2d lane = way.middle + side * way.along;
  if (outside_) {
    pose_.x = lane.x(), pose_.y = lane.y();  // what is nearest is meant from here
    add(MotionKind::kAppear, std::atan2(way.inward.y(), way.inward.x()), door,
        lane - 1.1 * way.inward);
    add(MotionKind::kOpenDoor, 0.8, door);
    add(MotionKind::kStraight, 0, door, lane + 0.45 * way.inward);
  }
  if (act.to || act.seat >= 0) {
    walk_to(destination(act, stage));
  } else if (outside_ && passenger_->start) {
    walk_to(*passenger_->start);
  } else {
    // Without a place to go to one clears the doorway.
    const double spread = 0.8 * (2 * uniform(mixed(seed_, 9, next_act_)) - 1);
    walk_to(lane + (0.9 + 0.3 * uniform(mixed(seed_, 10))) * way.inward + spread * way.along);
  }
}

void Actor::begin_sit(const SceneAct& act, const Surroundings& stage) {
  int seat = act.seat;
  if (seat < 0) seat = nearest_seat(act.to.value_or(at()), stage);
  if (seat < 0) return;  // all are taken: it goes on standing
  if (seat_ == seat && pose_.sit > 0.5) return;
  get_up();
  const SceneSeat& place = stage.scene->seats[static_cast<std::size_t>(seat)];
  walk_to(before_seat(place));
  add(MotionKind::kTurn, place.yaw);
  add(MotionKind::kSit, 1.2, seat);
}

void Actor::begin_lean(const SceneAct& act, const Surroundings& stage) {
  if (act.seat >= 0 && seat_ != act.seat) begin_sit(act, stage);
  Vector2d towards = at() + direction_of(pose_.yaw);
  if (act.to) {
    towards = *act.to;
    const Vector2d gap = towards - at();
    constexpr double kArm = 0.9;  // farther away than this one walks there first
    if (act.seat < 0 && gap.norm() > kArm) {
      get_up();
      walk_to(towards - 0.4 * gap.normalized());
    }
  } else {
    double least = 1.3;  // lean together with whoever is beside
    for (std::size_t i = 0; i < stage.neighbours.size(); ++i) {
      const double d = (stage.neighbours[i].position - at()).norm();
      if (i == index_ || !stage.neighbours[i].present || d >= least) continue;
      least = d;
      towards = stage.neighbours[i].position;
    }
  }
  add(MotionKind::kLean, 0.8, 0, towards);
}

void Actor::begin_lie(const SceneAct& act, const Surroundings& stage) {
  if (pose_.recline > 0.5) return;
  if (act.seat < 0) {
    if (act.to) {
      get_up();
      walk_to(*act.to);
    }
    add(MotionKind::kLieDown, 2.5, -1, act.to.value_or(at()));
    return;
  }
  get_up();
  const SceneSeat& seat = stage.scene->seats[static_cast<std::size_t>(act.seat)];
  walk_to(before_seat(seat));
  add(MotionKind::kTurn, seat.yaw);
  add(MotionKind::kLieDown, 3.0, act.seat);
}

void Actor::begin_item(const SceneAct& act, const Surroundings& stage) {
  const bool takes = act.kind == ActKind::kTake;
  const int item = takes ? find_item(act, stage) : -1;
  if (takes && item < 0) return;  // nobody has put such a thing down
  const Vector2d place = takes ? (*stage.items)[static_cast<std::size_t>(item)].position
                               : act.to.value_or(at() + 0.45 * direction_of(pose_.yaw));
  const bool pram = act.item == "pram";
  const double reach = pram ? 0.9 : 0.5;
  const Vector2d gap = place - at();
  const bool near = gap.norm() < reach + 0.2;
  if (!near || pose_.recline > 0) get_up();
  if (!near) walk_to(place - reach * gap.normalized());
  if (takes || act.to) add(MotionKind::kTurn, 0, kFaceThePlace, place);
  if (!pram) add(MotionKind::kBend, 0.7);
  const Vector2d dropped = act.to ? place : Vector2d::Zero();
  add(takes ? MotionKind::kTake : MotionKind::kPut, act.to ? 1 : 0, takes ? item : (pram ? 1 : 0),
      dropped);
  if (!pram) add(MotionKind::kStraighten, 0.7);
}

void Actor::begin_leave(const SceneAct& act, const Surroundings& stage) {
  int door = act.door;
  if (door < 0) door = nearest_door(stage);
  if (door < 0) return;
  get_up();
  const Doorway& way = stage.doorways[static_cast<std::size_t>(door)];
  const double room = std::max(0.0, 0.5 * way.width - 0.35);
  const double side = room * (2 * uniform(mixed(seed_, 11, next_act_)) - 1);
  const Vector2d lane = way.middle + side * way.along;
  walk_to(lane + 0.5 * way.inward);
  add(MotionKind::kOpenDoor, 0.8, door);
  add(MotionKind::kStraight, 0, door, lane - 1.3 * way.inward);
  add(MotionKind::kVanish);
}

void Actor::begin(const SceneAct& act, const Surroundings& stage) {
  motions_.clear();
  motion_ = 0;
  started_ = false;
  if (act.speed > 0) cruise_ = act.speed;
  if (outside_ && act.kind == ActKind::kLeave) return;
  if (act.kind == ActKind::kEnter) {
    if (!outside_) get_up();
    begin_enter(act, stage);
  } else if (outside_) {
    begin_enter({act.at, ActKind::kEnter, {}, -1, -1, 0, {}}, stage);
  }
  switch (act.kind) {
    case ActKind::kEnter:
      break;
    case ActKind::kWalk:
    case ActKind::kStand:
      get_up();
      if (act.to || act.seat >= 0 || act.door >= 0) walk_to(destination(act, stage));
      break;
    case ActKind::kSit:
      begin_sit(act, stage);
      break;
    case ActKind::kLean:
      begin_lean(act, stage);
      break;
    case ActKind::kFall:
      if (pose_.recline < 0.5)
        add(MotionKind::kFall, 0.8, act.to ? 1 : -1, act.to.value_or(Vector2d::Zero()));
      break;
    case ActKind::kLie:
      begin_lie(act, stage);
      break;
    case ActKind::kRise:
      get_up();
      if (act.to) walk_to(*act.to);
      break;
    case ActKind::kPut:
    case ActKind::kTake:
      begin_item(act, stage);
      break;
    case ActKind::kLeave:
      begin_leave(act, stage);
      break;
  }
}

void Actor::tick(double now, double dt, const Surroundings& stage) {
  while (motion_ >= motions_.size()) {
    door_in_use_ = -1;
    const double repeat_s = stage.scene->repeat_s;
    if (repeat_s > 0 && !passenger_->acts.empty() && next_act_ == passenger_->acts.size()) {
      next_act_ = 0;
      round_began_ += repeat_s;
    }
    const bool acts_left = next_act_ < passenger_->acts.size();
    if (acts_left && round_began_ + passenger_->acts[next_act_].at <= now) {
      begin(passenger_->acts[next_act_], stage);
      ++next_act_;
      continue;
    }
    if (outside_ && next_act_ == 0 && !acts_left && passenger_->door >= 0) {
      next_act_ = 1;  // a passenger with a door and nothing to do comes in and stands
      begin({0, ActKind::kEnter, {}, -1, -1, 0, {}}, stage);
      continue;
    }
    speed_ = 0;
    pose_.step = std::max(0.0, pose_.step - 2 * dt);
    return;
  }
  if (run(motions_[motion_], dt, stage)) {
    ++motion_;
    started_ = false;
  }
}

}  // namespace wagonsight
