#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>

#include "base/fixed_vector.h"
#include "simulate/body.h"
#include "simulate/floor_plan.h"
#include "simulate/room.h"

namespace wagonsight {

// A bag or a pram that stands somewhere by itself.
struct StandingItem {
  FixedString<40> name;
  bool pram = false;
  bool there = false;
  Eigen::Vector2d position = Eigen::Vector2d::Zero();
  double yaw = 0;
  std::int32_t owner = 0;  // passenger index
};
inline constexpr std::size_t kItemsMax = 2 * kPeopleMax;
using StandingItems = FixedVector<StandingItem, kItemsMax>;

// What a passenger can know of the others while it walks.
struct Neighbour {
  Eigen::Vector2d position = Eigen::Vector2d::Zero();
  bool present = false;
  bool upright = true;
  int seat = -1;  // sat on or walked to
};

// What all passengers of a scene share; the world owns it.
struct Surroundings {
  const Scene* scene = nullptr;
  FloorPlan* plan = nullptr;
  std::span<const Doorway> doorways;
  std::span<const Neighbour> neighbours;  // by passenger
  StandingItems* items = nullptr;
};

// One passenger: works through the acts of the scene, each broken down into motions that run one
// after the other.
//
//   waiting for `at` --> motions of the act, one by one --> waiting for the next act
//
// An act whose time comes while another one runs begins when that one has ended.
class Actor {
 public:
  Actor(const ScenePassenger& passenger, std::size_t index, const Surroundings& stage,
        std::uint64_t seed);

  // Goes on by one tick of `dt` seconds that ends at `now`. Does not allocate.
  void tick(double now, double dt, const Surroundings& stage);

  // Moves a little, where there is floor to stand on, because somebody else is in the way.
  void give_way(const Eigen::Vector2d& shift, const Surroundings& stage);

  const Figure& figure() const { return figure_; }
  const Pose& pose() const { return pose_; }
  Neighbour as_neighbour() const;
  // The door the passenger is about to use or is using, or -1.
  int door_in_use() const { return door_in_use_; }

 private:
  enum class MotionKind : std::uint8_t {
    kAppear,
    kVanish,
    kWait,
    kOpenDoor,
    kFollow,
    kStraight,
    kTurn,
    kSit,
    kStandUp,
    kLean,
    kFall,
    kLieDown,
    kRise,
    kBend,
    kPut,
    kTake,
    kStraighten,
  };
  // In front of a seat's middle, metres, one turns and sits down; the pelvis comes to rest a little
  // behind the middle.
  static constexpr double kSeatApproach = 0.45, kSeatBack = 0.08;
  static constexpr int kFaceThePlace = -2;  // index of a kTurn towards Motion::to
  struct Motion {
    MotionKind kind = MotionKind::kWait;
    Eigen::Vector2d to = Eigen::Vector2d::Zero();
    double value = 0;  // seconds, radians or metres, as the kind needs it
    int index = -1;    // of a seat, a door or an item
  };

  static Eigen::Vector2d before_seat(const SceneSeat& seat);
  void begin(const SceneAct& act, const Surroundings& stage);
  void begin_enter(const SceneAct& act, const Surroundings& stage);
  void begin_sit(const SceneAct& act, const Surroundings& stage);
  void begin_lean(const SceneAct& act, const Surroundings& stage);
  void begin_lie(const SceneAct& act, const Surroundings& stage);
  void begin_item(const SceneAct& act, const Surroundings& stage);
  void begin_leave(const SceneAct& act, const Surroundings& stage);
  void get_up();
  void walk_to(const Eigen::Vector2d& to);
  void add(MotionKind kind, double value = 0, int index = -1,
           const Eigen::Vector2d& to = Eigen::Vector2d::Zero());
  Eigen::Vector2d destination(const SceneAct& act, const Surroundings& stage) const;
  int nearest_seat(const Eigen::Vector2d& near, const Surroundings& stage) const;
  int nearest_door(const Surroundings& stage) const;
  int find_item(const SceneAct& act, const Surroundings& stage) const;

  bool run(const Motion& motion, double dt, const Surroundings& stage);  // true when it has ended
  bool follow(const Motion& motion, double dt, const Surroundings& stage);
  bool step_towards(const Eigen::Vector2d& to, double dt, bool last, bool evade,
                    const Surroundings& stage);
  bool turn_towards(double yaw, double rate, double dt);
  bool settle(MotionKind kind, double seconds, double dt);
  bool lean(const Motion& motion, double dt);
  void appear(const Motion& motion);
  void slow_down(double dt);
  bool sit_down(const Motion& motion, double dt, const Surroundings& stage);
  bool recline(const Motion& motion, double seconds, double dt, const Surroundings& stage);
  double clear_fall_direction(double wanted, const Surroundings& stage) const;
  void handle_item(const Motion& motion, const Surroundings& stage);
  double eased(double dt, double seconds);  // progress_ goes on; smooth 0..1
  Eigen::Vector2d evade(const Eigen::Vector2d& direction, double& pace,
                        const Surroundings& stage) const;
  Eigen::Vector2d at() const { return {pose_.x, pose_.y}; }

  const ScenePassenger* passenger_;
  std::size_t index_;
  Figure figure_;
  Pose pose_;
  std::uint64_t seed_;
  double cruise_ = 1.2;  // m/s
  double speed_ = 0;     // m/s, now
  double patience_ = 0;  // seconds it has been held up
  double squeeze_ = 0;   // seconds for which it pushes through
  std::size_t next_act_ = 0;
  double round_began_ = 0;  // when the scene began, the last time
  FixedVector<Motion, 24> motions_;
  std::size_t motion_ = 0;
  bool started_ = false;  // of the running motion
  double progress_ = 0;
  Pose from_;  // the pose in which the running motion began
  Waypoints way_;
  std::size_t waypoint_ = 0;
  int seat_ = -1;
  int door_in_use_ = -1;
  bool outside_ = false;
};

}  // namespace wagonsight
