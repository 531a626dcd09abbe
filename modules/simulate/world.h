#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/time.h"
#include "simulate/actor.h"
#include "simulate/body.h"
#include "simulate/floor_plan.h"
#include "simulate/room.h"
#include "simulate/scene.h"
#include "snapshot/snapshot.h"

namespace wagonsight {

// The passengers of a scene in virtual time: who stands where in which pose at any instant, and
// the truth of it. Two worlds with the same scene and seed are equal at every instant, so that each
// sensor may own one. Time goes forward in ticks of 10 ms; instants of the last second or so can
// still be asked for. Allocates only when made. One thread.
class World {
 public:
  World(const Scene& scene, std::uint64_t seed);
  ~World() = default;
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  const Scene& scene() const { return scene_; }
  std::size_t passenger_count() const { return actors_.size(); }
  const Figure& figure(std::size_t passenger) const { return actors_[passenger].figure(); }

  // The pose at an instant; instants before the beginning count as the beginning.
  Pose pose_at(std::size_t passenger, HostTime instant);
  // How far the leaves of a door are open, 0..1.
  double door_open_at(std::size_t door, HostTime instant);
  // A ball of the scene.
  Part ball_at(std::size_t ball, HostTime instant) const;
  // Standing luggage at an instant; what was put down or taken within one tick is exact to it.
  const StandingItems& items_at(HostTime instant);

  // Everybody whose torso is within the wagon: ids are 1 + the index in the scene. The view
  // attributes, sigma and events are left empty. `time` is seconds since the beginning.
  void truth_at(HostTime instant, PeopleFrame& truth);

 private:
  // Enough for frames that lag behind the newest instant by a second: 128 ticks of 10 ms.
  static constexpr std::size_t kHistory = 128;
  static constexpr std::int64_t kTickNs = 10'000'000;

  struct Bracket {  // the two ticks around an instant
    std::size_t before = 0, after = 0;
    double share = 0;
  };
  Bracket reach(HostTime instant);
  void tick();
  void remember();
  void keep_apart(double dt);
  void move_doors(double dt);
  bool inside(const Eigen::Vector2d& p) const;

  Scene scene_;
  FloorPlan plan_;
  std::vector<Doorway> doorways_;
  std::vector<Actor> actors_;
  std::vector<Neighbour> neighbours_;
  std::vector<double> door_open_, door_hold_;
  StandingItems items_;
  Surroundings stage_;
  std::int64_t ticks_ = 0;     // done so far
  std::vector<Pose> poses_;    // kHistory x passengers
  std::vector<double> doors_;  // kHistory x doors
  std::vector<StandingItems> item_history_;
};

}  // namespace wagonsight
