#pragma once

#include <cstdint>
#include <span>

#include "base/bounded_vector.h"
#include "fusion/visibility.h"
#include "people/assignment.h"
#include "people/describe.h"
#include "people/detect.h"
#include "people/motion.h"
#include "snapshot/snapshot.h"
#include "wagon/wagon.h"

namespace wagonsight {

// A track's life:
//
//   tentative --confirmed--> followed <--seen again-- hidden --too long--> (ended)
//       |                       |                        ^
//       +--missed--> (ended)    +---not seen, may be-----+
//                                   behind something
//
// Tentative tracks are told to nobody. Hidden ones are told as long as somebody can still be where
// they are; after that they only wait to be recognised.
enum class TrackState : std::uint8_t { kTentative, kFollowed, kHidden };

struct TrackOptions {
  double acceleration = 1.6;  // m/s^1.5: people start and stop walking within a second
  double gate_min_m = 0.7;    // a step between two frames at 2.5 Hz, whatever rate was stated
  double gate_max_m = 1.6;
  double confirm_s = 0.12;         // and two frames; at once less with twice a full body in view
  std::uint32_t confirm_hits = 2;  // frames; 1: whoever is detected is told at once
  double confirm_far_from_doors_s = 0.5;
  double coast_walking_s = 1.5;     // told while behind something and walking
  double coast_standing_s = 10.0;   // and while standing
  double coast_sitting_s = 60.0;    // and while sitting or lying: nobody rises unseen
  double coast_lost_sight_s = 0.2;  // told after leaving every sensor's view
  double remember_s = 4.0;          // recognised when seen again
  double inside_s = 30.0;           // and who did not leave by a door, wherever he turns up
  double gone_s = 0.5;              // seen through for so long: not there
};

struct Track {
  TrackState state = TrackState::kTentative;
  MotionFilter motion;
  Person person;  // id is 0 until confirmed
  double evidence = 0;
  std::uint32_t hits = 0;
  double free_since = -1;  // the place was seen to be empty since then; -1: it was not
  bool told = false;       // part of what is reported at this instant
  double head_top = 0;     // highest point at last sight
  double upright_s = 0;    // for how long it was seen standing free: its height is known then
  bool crowded = false;    // somebody is within reach: their parts may be mixed up
  double thing_s = 0;      // for how long it has looked like a thing
  bool thing = false;      // a pram or the like: followed, but told to nobody
  bool came_in = false;    // was seen clearly inside
  bool went_out = false;   // then left by a door, and has not come back in
  bool lives_on = false;   // in another track, which has its identity
  bool settled = false;    // has long sat or stood at `anchor`
  std::array<double, 2> anchor{};
  double still_since = 0;                    // for how long it has hardly moved
  double whole_s = 0;                        // when enough for a person by itself was seen last
  std::array<float, 2> last_tops{};          // of the two sights before this one
  bool cut_side = false;                     // at an image border at last sight
  Posture posture_seen = Posture::kUnknown;  // by the last sight alone
  double posture_since = 0;
  std::uint16_t detection = kNoDetection;  // at this instant
};

class Tracker {
 public:
  // `wagon` tells where people sit. Allocates here and never again.
  explicit Tracker(const Wagon& wagon, const TrackOptions& options = {});

  // Moves all tracks to `now_s` (seconds, never decreasing) and says where people are expected.
  std::span<const PersonPrior> predict(double now_s);
  // Pairs the tracks with what was detected at the time of the last predict().
  void update(std::span<const Detection> detections, std::span<const BodyShape> shapes,
              const VisibilityGrid& visibility);

  std::span<const Track> tracks() const { return tracks_.span(); }
  std::uint32_t tracks_dropped() const { return tracks_dropped_; }

 private:
  void associate(std::span<const Detection> detections);
  float pair_cost(const Track& track, const Detection& detection) const;
  void see(Track& track, const Detection& detection, const BodyShape& shape);
  void follow(Track& track);
  Track* lost_one_like(const Track& track);
  void look_around();
  void miss(Track& track, const VisibilityGrid& visibility);
  void begin(std::span<const Detection> detections, std::span<const BodyShape> shapes);
  void drop_ended();
  void drop_doubles();
  void measure_height(Track& track, const Detection& detection) const;
  void judge_posture(Track& track, const Detection& detection) const;
  void confirm(Track& track, const Detection& detection);
  void judge_thing(Track& track, const Detection& detection) const;
  void settle(Track& track, const Detection& detection) const;
  bool is_inside(Track& track) const;
  bool near_seat(const Track& track) const;
  bool rests(const Track& track) const;
  void tell(Track& track, const BodyShape& shape, const Detection& detection) const;

  Wagon wagon_;
  TrackOptions options_;
  Assignment assignment_;
  BoundedVector<Track> tracks_;
  BoundedVector<PersonPrior> priors_;
  BoundedVector<float> costs_;
  BoundedVector<std::uint8_t> taken_;  // by detection
  double now_s_ = 0;
  double dt_s_ = 0;
  bool started_ = false;
  std::uint32_t next_id_ = 1;
  std::uint32_t tracks_dropped_ = 0;
};

}  // namespace wagonsight
