#pragma once

#include <cstdint>
#include <span>

#include "base/bounded_vector.h"
#include "fusion/visibility.h"
#include "snapshot/snapshot.h"
#include "wagon/wagon.h"

// What the people mean for the wagon: who fills which zone and seat, who came and went by which
// door, and what happened to whom.
namespace wagonsight {

struct SituationOptions {
  double fall_s = 2.5;  // from standing to lying, whatever was seen between
  double drop_s = 1.0;  // from upright to the floor in sight; who lies down takes longer
  double motionless_lying_s = 15.0;  // no movement while lying
  double motionless_s = 1800.0;      // or in any other posture
  double motionless_m = 0.25;        // smaller movements are noise
  double running_speed = 2.5;        // m/s; people walk at 0.5 to 2
  double running_s = 0.5;
  double crowding_per_m2 = 4.0;  // standing at this density nobody can pass
  double crowding_s = 3.0;
};

// What is remembered of a person between two instants.
struct Story {
  std::uint32_t person = 0;
  double first_s = 0, last_s = 0;
  std::array<double, 2> position{};
  std::array<double, 2> rest_position{};  // and since when it was not left
  double rest_since_s = 0;
  double upright_until_s = -1;
  double tallest = 0;        // metres
  double high_until_s = -1;  // its top was where it is when standing
  double low_since_s = -1;   // and then below half of that
  double unseen_s = -1;      // when it was last told without being seen
  double lying_since_s = -1;
  bool fell = false;
  double running_since_s = -1;
  std::int32_t came_by = -1;  // door, until the person has left it behind
  bool was_inside = false;    // away from every door
};

class Situation {
 public:
  // Allocates here and never again.
  explicit Situation(const Wagon& wagon, const SituationOptions& options = {});

  // Takes the people of an instant, writes their events into `frame` and says who fills what.
  // `doors`: what the train says of its doors, in the wagon's order; nobody comes or goes by one
  // that is closed, and one of which nothing is known may be open. The Occupancy stays valid until
  // the next call.
  const Occupancy& update(PeopleFrame& frame, const VisibilityGrid& visibility,
                          std::span<const DoorState> doors = {});
  const Occupancy& occupancy() const { return occupancy_; }

 private:
  Story& story_of(const Person& person, double now_s);
  void follow(const Person& person, Story& story, double now_s);
  void follow_fall(const Person& person, Story& story, double now_s) const;
  void end_stories(double now_s);
  void hear_doors(std::span<const DoorState> doors, double now_s);
  int door_near(const std::array<double, 2>& position) const;
  // Of door_near: -1 where that door was closed then.
  int door_passed(const std::array<double, 2>& position, double then_s) const;

  void count_zones(const PeopleFrame& frame, const VisibilityGrid& visibility);
  void judge_seats(const PeopleFrame& frame, const VisibilityGrid& visibility);

  void tell_fall(const Person& person, const Story& story, PeopleFrame& frame) const;
  void tell_motionless(const Person& person, const Story& story, PeopleFrame& frame) const;
  void tell_running(const Person& person, const Story& story, PeopleFrame& frame) const;
  void tell_crowding(PeopleFrame& frame);

  Wagon wagon_;
  SituationOptions options_;
  BoundedVector<Story> stories_;
  std::array<double, kZonesMax> zone_area_m2_{};
  std::array<double, kZonesMax> crowded_since_s_{};
  std::array<double, kDoorsMax> passable_until_s_{};  // by door
  Occupancy occupancy_;
};

}  // namespace wagonsight
