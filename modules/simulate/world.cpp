#include "simulate/world.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {

World::World(const Scene& scene, std::uint64_t seed) : scene_(scene), plan_(scene_) {
  for (const SceneDoor& door : scene_.doors) doorways_.push_back(doorway_of(scene_, door));
  neighbours_.resize(scene_.passengers.size());
  door_open_.resize(scene_.doors.size());
  door_hold_.resize(scene_.doors.size());
  stage_ = {&scene_, &plan_, doorways_, neighbours_, &items_};
  actors_.reserve(scene_.passengers.size());
  for (std::size_t i = 0; i < scene_.passengers.size(); ++i) {
    actors_.emplace_back(scene_.passengers[i], i, stage_, seed);
    neighbours_[i] = actors_[i].as_neighbour();
  }
  poses_.resize(kHistory * actors_.size());
  doors_.resize(kHistory * doorways_.size());
  item_history_.resize(kHistory);
  remember();
}

void World::remember() {
  const std::size_t row = static_cast<std::size_t>(ticks_) % kHistory;
  for (std::size_t i = 0; i < actors_.size(); ++i)
    poses_[row * actors_.size() + i] = actors_[i].pose();
  for (std::size_t i = 0; i < doorways_.size(); ++i)
    doors_[row * doorways_.size() + i] = door_open_[i];
  item_history_[row] = items_;
}

void World::move_doors(double dt) {
  constexpr double kLeafSeconds = 0.8, kHoldSeconds = 1.5;
  for (std::size_t door = 0; door < doorways_.size(); ++door) {
    door_hold_[door] -= dt;
    for (const Actor& actor : actors_)
      if (actor.door_in_use() == static_cast<int>(door)) door_hold_[door] = kHoldSeconds;
    const double change = door_hold_[door] > 0 ? dt : -dt;
    door_open_[door] = std::clamp(door_open_[door] + change / kLeafSeconds, 0.0, 1.0);
  }
}

// Two who stand or walk cannot be in one place: they give way to each other, slowly.
void World::keep_apart(double dt) {
  constexpr double kApart = 0.42, kGivesWay = 0.5;  // metres between middles; metres a second
  for (std::size_t i = 0; i < actors_.size(); ++i) {
    for (std::size_t j = i + 1; j < actors_.size(); ++j) {
      const Neighbour &a = neighbours_[i], &b = neighbours_[j];
      if (!a.present || !b.present || !a.upright || !b.upright) continue;
      const Eigen::Vector2d gap = b.position - a.position;
      const double distance = gap.norm();
      if (distance >= kApart || distance < 1e-6) continue;
      const Eigen::Vector2d shift =
          gap / distance * std::min(0.5 * (kApart - distance), kGivesWay * dt);
      actors_[i].give_way(-shift, stage_);
      actors_[j].give_way(shift, stage_);
    }
  }
  for (std::size_t i = 0; i < actors_.size(); ++i) neighbours_[i] = actors_[i].as_neighbour();
}

void World::tick() {
  ++ticks_;
  constexpr double kTickSeconds = static_cast<double>(kTickNs) * 1e-9;
  const double now = static_cast<double>(ticks_) * kTickSeconds;
  for (std::size_t i = 0; i < actors_.size(); ++i) {
    actors_[i].tick(now, kTickSeconds, stage_);
    neighbours_[i] = actors_[i].as_neighbour();
  }
  keep_apart(kTickSeconds);
  move_doors(kTickSeconds);
  remember();
}

World::Bracket World::reach(HostTime instant) {
  const std::int64_t ns = std::max<std::int64_t>(0, instant.time_since_epoch().count());
  const std::int64_t before = ns / kTickNs;
  while (ticks_ < before + 1) tick();
  const std::int64_t oldest = ticks_ - static_cast<std::int64_t>(kHistory) + 1;
  WS_CHECK(before >= oldest, "tick %lld is forgotten, the oldest is %lld",
           static_cast<long long>(before), static_cast<long long>(oldest));
  return {static_cast<std::size_t>(before) % kHistory,
          static_cast<std::size_t>(before + 1) % kHistory,
          static_cast<double>(ns % kTickNs) / static_cast<double>(kTickNs)};
}

Pose World::pose_at(std::size_t passenger, HostTime instant) {
  const Bracket at = reach(instant);
  const std::size_t n = actors_.size();
  return interpolate(poses_[at.before * n + passenger], poses_[at.after * n + passenger], at.share);
}

double World::door_open_at(std::size_t door, HostTime instant) {
  const Bracket at = reach(instant);
  const std::size_t n = doorways_.size();
  const double before = doors_[at.before * n + door], after = doors_[at.after * n + door];
  return before + at.share * (after - before);
}

Part World::ball_at(std::size_t ball, HostTime instant) const {
  const SceneBall& told = scene_.balls[ball];
  Part part;
  part.centre = told.centre_at(to_seconds(instant.time_since_epoch()));
  part.half.setConstant(told.radius);
  return part;
}

const StandingItems& World::items_at(HostTime instant) {
  return item_history_[reach(instant).before];
}

bool World::inside(const Eigen::Vector2d& p) const {
  return p.x() >= 0 && p.y() >= 0 && p.x() <= scene_.length && p.y() <= scene_.width;
}

void World::truth_at(HostTime instant, PeopleFrame& truth) {
  truth.time = to_seconds(instant.time_since_epoch());
  truth.people.clear();
  truth.events.clear();
  truth.skews.clear();
  constexpr Duration kStep = std::chrono::milliseconds(20);  // for the velocity, to both sides
  const bool at_start = instant.time_since_epoch() < kStep;
  const HostTime earlier = at_start ? instant : instant - kStep, later = instant + kStep;
  Parts parts;
  const auto torso_at = [&](std::size_t i, HostTime when, Person& person) {
    const Pose pose = pose_at(i, when);
    parts.clear();
    clad(figure(i), pose, 0, parts);
    person = describe(figure(i), pose, parts);
    return pose.present;
  };
  for (std::size_t i = 0; i < actors_.size(); ++i) {
    Person person, before, after;
    if (!pose_at(i, instant).present) continue;
    const bool has_after = torso_at(i, later, after), has_before = torso_at(i, earlier, before);
    torso_at(i, instant, person);
    if (!inside({person.position[0], person.position[1]})) continue;
    person.id = static_cast<std::uint32_t>(i + 1);
    person.last_seen = truth.time;
    if (has_after && has_before) {
      const double span = to_seconds(later - earlier);
      for (std::size_t k = 0; k < 2; ++k)
        person.velocity[k] = (after.position[k] - before.position[k]) / span;
    }
    if (!truth.people.try_push_back(person)) break;
  }
}

}  // namespace wagonsight
