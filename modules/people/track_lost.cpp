#include <algorithm>
#include <cmath>

#include "people/track.h"
#include "people/track_common.h"

// What becomes of tracks that are not seen: they wait, end, or live on in another one.
namespace wagonsight {
namespace {

constexpr double kSameEnough = 0.15;  // two tracks nearer than this follow one person
constexpr double kDoorway = 0.30;     // who is lost sight of here has left
constexpr double kPartsOnly = 6.0;    // seconds without the sight of a whole person
constexpr double kHeightsDiffer = 0.12;
constexpr double kLostReach = 0.6;  // metres, and so many more for each second out of sight
constexpr double kLostSpeed = 1.2;
constexpr double kLostReachMax = 4.0;

}  // namespace

void Tracker::miss(Track& track, const VisibilityGrid& visibility) {
  if (track.state == TrackState::kTentative) {
    track.told = false;
    track.hits = 0;  // ends
    return;
  }
  track.state = TrackState::kHidden;
  const auto position = track.motion.position();
  const auto velocity = track.motion.velocity();
  track.person.velocity = {velocity.x(), velocity.y()};
  const auto sigma = track.motion.position_sigma();
  track.person.sigma = {sigma.x(), sigma.y()};
  track.person.views.clear();
  const ColumnView view =
      visibility.look_at_column(position.x(), position.y(), std::max(0.8, track.head_top));
  const double unseen_s = now_s_ - track.person.last_seen;
  // Who rests is not given up for a glance past the shoulder. Neither is who stands beside
  // somebody, away from the doors: he is taken for a part of the neighbour, and not just where he
  // was.
  const bool resting = rests(track);
  const bool beside = track.crowded && !wagon_.doors.empty() &&
                      depth_inside(wagon_, track.person.position).door < 0;
  if (view.free > (resting ? 0.75F : 0.5F)) {
    if (track.free_since < 0) track.free_since = now_s_;
    track.told = track.told && (resting || beside) && now_s_ - track.free_since < options_.gone_s;
    return;
  }
  track.free_since = -1;
  const DepthInside depth = depth_inside(wagon_, {position.x(), position.y()});
  if (depth.m < kThreshold || (depth.door >= 0 && depth.m < kDoorway && !track.settled)) {
    track.told = false;
    return;
  }
  double coast_s = options_.coast_walking_s;
  if (resting) coast_s = options_.coast_standing_s;
  if (track.person.posture == Posture::kSitting || track.person.posture == Posture::kLying)
    coast_s = options_.coast_sitting_s;
  // Somebody is there, but taken for a part of a neighbour: only who was followed for long is
  // believed in for long.
  if (view.surface > 0.5F && now_s_ - track.person.since < kWellKnown)
    coast_s = options_.coast_walking_s;
  // Who was at an image border has left by it.
  if (track.cut_side && !resting)
    coast_s = 0;
  else if (view.outside > 0.5F)
    coast_s = options_.coast_lost_sight_s;
  // Nobody is believed in for much longer than was seen.
  coast_s = std::min(coast_s, 0.2 + 2 * (track.person.last_seen - track.person.since));
  track.told = track.told && unseen_s <= coast_s;
}

// Nobody comes into being in the middle of a wagon: who turns up there is somebody who was lost
// sight of and has not left by a door, the one nearest in place and height whom the way and the
// time allow. Null when there is none.
Track* Tracker::lost_one_like(const Track& track) {
  if (wagon_.doors.empty()) return nullptr;
  Track* best = nullptr;
  double best_cost = 2.0;
  for (Track& lost : tracks_) {
    if (lost.state != TrackState::kHidden || lost.detection != kNoDetection || lost.thing ||
        lost.went_out || lost.lives_on)
      continue;
    const double unseen_s = now_s_ - lost.person.last_seen;
    const double reach = std::min(kLostReachMax, kLostReach + kLostSpeed * unseen_s);
    const double taller = track.person.height - lost.person.height;
    const bool upright = track.person.posture == Posture::kStanding;
    const double differs =
        upright && height_is_known(lost) ? std::abs(taller) : std::max(0.0, taller);
    const double cost =
        distance(track.person.position, lost.person.position) / reach + differs / kHeightsDiffer;
    if (differs > kHeightsDiffer || cost >= best_cost) continue;
    best = &lost;
    best_cost = cost;
  }
  return best;
}

void Tracker::drop_ended() {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    const Track& track = tracks_[i];
    const double unseen_s = now_s_ - track.person.last_seen;
    const bool missed = track.state == TrackState::kTentative && track.hits == 0;
    const bool gone = track.free_since >= 0 && now_s_ - track.free_since > options_.gone_s &&
                      unseen_s > options_.coast_walking_s;
    // Parts alone are not believed in for ever, except on a seat, where parts are all one sees.
    const bool parts_only =
        !track.thing && (track.detection != kNoDetection && now_s_ - track.whole_s > kPartsOnly &&
                         !near_seat(track) && track.person.posture != Posture::kLying);
    const bool inside = !wagon_.doors.empty() && !track.went_out && !track.thing;
    const bool forgotten =
        track.lives_on ||
        (!track.told && unseen_s > (inside ? options_.inside_s : options_.remember_s));
    if (missed || (gone && !inside) || forgotten || parts_only) continue;
    if (kept != i) tracks_[kept] = tracks_[i];
    ++kept;
  }
  tracks_.resize(kept);
}

// A hidden track that waits where another one is seen waits for the same person.
void Tracker::drop_doubles() {
  for (Track& hidden : tracks_) {
    if (hidden.state != TrackState::kHidden || !hidden.told) continue;
    for (const Track& seen : tracks_)
      if (seen.detection != kNoDetection && seen.state == TrackState::kFollowed &&
          distance(seen.person.position, hidden.person.position) < kSameEnough)
        hidden.told = false;
  }
}

}  // namespace wagonsight
