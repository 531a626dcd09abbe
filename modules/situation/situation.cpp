#include "situation/situation.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

constexpr double kLongAgo = -1e9;
constexpr double kDoorGrace = 2.0;     // seconds a door stays passable: tracks begin late
constexpr double kDoorReach = 0.8;     // metres from the threshold: in the doorway
constexpr double kStoryMemory = 2.0;   // seconds without the person until a story ends
constexpr double kSeatReach = 0.45;    // metres from a seat's centre to its sitter's torso
constexpr double kSeatObserved = 0.3;  // its back and its neighbours always hide a part
constexpr double kSitterTop = 1.5;     // metres: higher is standing in front of the seat
// Shares of somebody's height: upright, and on the floor or nearly.
constexpr double kHighShare = 0.85, kLowShare = 0.45;
constexpr double kSeenNow = 1e-3;                // seconds
constexpr double kAirLow = 0.5, kAirHigh = 1.7;  // metres above the floor: what a person fills

double distance(const std::array<double, 2>& a, const std::array<double, 2>& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1]);
}

double distance_to_segment(const std::array<double, 2>& p, const std::array<double, 2>& a,
                           const std::array<double, 2>& b) {
  const double ux = b[0] - a[0];
  const double uy = b[1] - a[1];
  const double length2 = ux * ux + uy * uy;
  const double along =
      length2 > 0 ? std::clamp(((p[0] - a[0]) * ux + (p[1] - a[1]) * uy) / length2, 0.0, 1.0) : 0;
  return std::hypot(p[0] - a[0] - along * ux, p[1] - a[1] - along * uy);
}

double polygon_area(const Zone& zone) {  // the shoelace formula
  double twice = 0;
  for (std::size_t i = 0; i < zone.polygon.size(); ++i) {
    const auto& a = zone.polygon[i];
    const auto& b = zone.polygon[(i + 1) % zone.polygon.size()];
    twice += a[0] * b[1] - a[1] * b[0];
  }
  return 0.5 * std::abs(twice);
}

Bounds air_over(double min_x, double max_x, double min_y, double max_y, double high) {
  return {{min_x, min_y, kAirLow}, {max_x, max_y, high}};
}

Bounds air_of(const Zone& zone) {
  Bounds box = air_over(1e9, -1e9, 1e9, -1e9, kAirHigh);
  for (const auto& corner : zone.polygon)
    for (int axis = 0; axis < 2; ++axis) {
      box.min[axis] = std::min(box.min[axis], corner[static_cast<std::size_t>(axis)]);
      box.max[axis] = std::max(box.max[axis], corner[static_cast<std::size_t>(axis)]);
    }
  return box;
}

}  // namespace

Situation::Situation(const Wagon& wagon, const SituationOptions& options)
    : wagon_(wagon), options_(options), stories_(kTracksMax) {
  for (const Zone& zone : wagon_.zones) {
    zone_area_m2_[occupancy_.zones.size()] = polygon_area(zone);
    occupancy_.zones.push_back({zone.name, 0, static_cast<std::uint32_t>(zone.capacity), 0});
  }
  for (const Seat& seat : wagon_.seats)
    occupancy_.seats.push_back({seat.name, Occupied::kUnobserved, 0});
  for (const Door& door : wagon_.doors) occupancy_.doors.push_back({door.name, 0, 0});
  crowded_since_s_.fill(-1);
  passable_until_s_.fill(kLongAgo);
}

const Occupancy& Situation::update(PeopleFrame& frame, const VisibilityGrid& visibility,
                                   std::span<const DoorState> doors) {
  frame.events.clear();
  hear_doors(doors, frame.time);
  for (const Person& person : frame.people) {
    Story& story = story_of(person, frame.time);
    follow(person, story, frame.time);
    tell_fall(person, story, frame);
    tell_motionless(person, story, frame);
    tell_running(person, story, frame);
  }
  end_stories(frame.time);
  count_zones(frame, visibility);
  judge_seats(frame, visibility);
  tell_crowding(frame);
  return occupancy_;
}

Story& Situation::story_of(const Person& person, double now_s) {
  std::size_t oldest = 0;
  for (std::size_t i = 0; i < stories_.size(); ++i) {
    if (stories_[i].person == person.id) return stories_[i];
    if (stories_[i].last_s < stories_[oldest].last_s) oldest = i;
  }
  Story story;
  story.person = person.id;
  story.first_s = story.rest_since_s = now_s;
  story.position = story.rest_position = person.position;
  story.came_by = door_passed(person.position, now_s);
  if (stories_.try_push_back(story)) return stories_[stories_.size() - 1];
  stories_[oldest] = story;  // cannot happen while there are fewer people than stories
  return stories_[oldest];
}

void Situation::follow(const Person& person, Story& story, double now_s) {
  story.last_s = now_s;
  story.position = person.position;
  if (distance(person.position, story.rest_position) > options_.motionless_m) {
    story.rest_position = person.position;
    story.rest_since_s = now_s;
  }
  follow_fall(person, story, now_s);
  const bool fast = std::hypot(person.velocity[0], person.velocity[1]) > options_.running_speed;
  if (!fast) story.running_since_s = -1;
  if (fast && story.running_since_s < 0) story.running_since_s = now_s;

  // Boarded is who came up in a doorway and has left it behind; who only leans out has not.
  const int door = door_near(person.position);
  if (door < 0) {
    if (story.came_by >= 0) ++occupancy_.doors[static_cast<std::size_t>(story.came_by)].boarded;
    story.came_by = -1;
    story.was_inside = true;
  }
}

// Who falls is down within a second; who lies down takes his time, and ends the same way. Of one
// who was out of sight in between only the whole is known.
void Situation::follow_fall(const Person& person, Story& story, double now_s) const {
  const double top = person.box.center[2] + 0.5 * person.box.size[2];
  const bool seen = person.last_seen >= now_s - kSeenNow;
  story.tallest = std::max({story.tallest, person.height, top});
  if (seen && top > kHighShare * story.tallest) {
    story.high_until_s = now_s;
    story.low_since_s = -1;
  } else if (seen && top < kLowShare * story.tallest && story.low_since_s < 0) {
    story.low_since_s = now_s;
  }
  story.unseen_s = seen ? story.unseen_s : now_s;
  if (person.posture != Posture::kLying) {
    story.lying_since_s = -1;
    story.fell = false;
    if (person.posture == Posture::kStanding) story.upright_until_s = now_s;
    return;
  }
  if (story.lying_since_s >= 0) return;
  story.lying_since_s = now_s;
  const double low_since_s = story.low_since_s < 0 ? now_s : story.low_since_s;
  const bool watched = story.unseen_s < story.high_until_s;
  const bool dropped =
      low_since_s - story.high_until_s <= (watched ? options_.drop_s : options_.fall_s);
  story.fell = dropped && story.high_until_s >= 0 && story.upright_until_s >= 0 &&
               now_s - story.upright_until_s <= options_.fall_s;
}

// Alighted is who was inside and was last seen in a doorway.
void Situation::end_stories(double now_s) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < stories_.size(); ++i) {
    const Story& story = stories_[i];
    if (now_s - story.last_s <= kStoryMemory) {
      if (kept != i) stories_[kept] = story;
      ++kept;
      continue;
    }
    const int door = door_passed(story.position, story.last_s);
    if (door >= 0 && story.was_inside) ++occupancy_.doors[static_cast<std::size_t>(door)].alighted;
  }
  stories_.resize(kept);
}

void Situation::hear_doors(std::span<const DoorState> doors, double now_s) {
  for (std::size_t i = 0; i < wagon_.doors.size(); ++i)
    if (i >= doors.size() || doors[i] != DoorState::kClosed) passable_until_s_[i] = now_s;
}

int Situation::door_passed(const std::array<double, 2>& position, double then_s) const {
  const int door = door_near(position);
  if (door < 0) return door;
  return then_s <= passable_until_s_[static_cast<std::size_t>(door)] + kDoorGrace ? door : -1;
}

int Situation::door_near(const std::array<double, 2>& position) const {
  int best = -1;
  double best_distance = kDoorReach;
  for (std::size_t i = 0; i < wagon_.doors.size(); ++i) {
    const double to_door = distance_to_segment(position, wagon_.doors[i].from, wagon_.doors[i].to);
    if (to_door >= best_distance) continue;
    best_distance = to_door;
    best = static_cast<int>(i);
  }
  return best;
}

void Situation::count_zones(const PeopleFrame& frame, const VisibilityGrid& visibility) {
  occupancy_.count = static_cast<std::uint32_t>(frame.people.size());
  const Bounds& inside = wagon_.inside;
  occupancy_.observed_share = visibility.observed_share(
      air_over(inside.min.x(), inside.max.x(), inside.min.y(), inside.max.y(), kAirHigh));
  for (std::size_t i = 0; i < wagon_.zones.size(); ++i) {
    ZoneOccupancy& zone = occupancy_.zones[i];
    zone.count = 0;
    for (const Person& person : frame.people)
      if (contains(wagon_.zones[i], person.position)) ++zone.count;
    zone.observed_share = visibility.observed_share(air_of(wagon_.zones[i]));
  }
}

void Situation::judge_seats(const PeopleFrame& frame, const VisibilityGrid& visibility) {
  for (std::size_t i = 0; i < wagon_.seats.size(); ++i) {
    const Seat& seat = wagon_.seats[i];
    SeatOccupancy& told = occupancy_.seats[i];
    told.state = Occupied::kUnobserved;
    told.person = 0;
    double nearest = kSeatReach;
    for (const Person& person : frame.people) {
      const double top = person.box.center[2] + 0.5 * person.box.size[2];
      const double away = distance(person.position, seat.position);
      if (away >= nearest || top > kSitterTop || person.posture == Posture::kStanding) continue;
      nearest = away;
      told.state = Occupied::kOccupied;
      told.person = person.id;
    }
    if (told.state == Occupied::kOccupied) continue;
    const double half = 0.5 * std::max(seat.width, 0.3);
    const Bounds air = air_over(seat.position[0] - half, seat.position[0] + half,
                                seat.position[1] - half, seat.position[1] + half, 1.3);
    if (visibility.observed_share(air) >= kSeatObserved) told.state = Occupied::kFree;
  }
  // One person fills one seat: the nearest.
  for (std::size_t i = 0; i < occupancy_.seats.size(); ++i)
    for (std::size_t j = 0; j < occupancy_.seats.size(); ++j) {
      SeatOccupancy& a = occupancy_.seats[i];
      const SeatOccupancy& b = occupancy_.seats[j];
      if (i == j || a.person == 0 || a.person != b.person) continue;
      for (const Person& person : frame.people)
        if (person.id == a.person && distance(person.position, wagon_.seats[i].position) >
                                         distance(person.position, wagon_.seats[j].position)) {
          a = {a.name, Occupied::kFree, 0};
          break;
        }
    }
}

}  // namespace wagonsight
