#include "people/track.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "people/track_common.h"

namespace wagonsight {
namespace {

constexpr float kImpossible = std::numeric_limits<float>::infinity();
// Costs are squared distances in units of this length: half the space between two people.
constexpr double kCostUnit = 0.35;
constexpr float kAloneCost = 30.0F;   // the widest gate squared in that unit, and what is added
constexpr double kHeightUnit = 0.15;  // metres of difference in height that count like one unit
constexpr double kRestingCostUnit = 0.25;
constexpr double kJustSeen = 0.3;       // seconds
constexpr double kPartReach = 0.5;      // metres
constexpr double kPartTopShare = 0.45;  // a sitter's knees are at a third of where his head was
constexpr double kHeadless = 0.25;      // metres lower than before, in part of a body
constexpr double kSettledSpeed = 0.25;  // m/s; below is swaying and noise
// Seen surface of two frames, in units of 0.25 square metres and at most one each.
constexpr double kEvidenceAtOnce = 1.2;
// Of a body in a doorway only what is inside is seen; its middle seems farther inside than it is.
constexpr double kDoorstep = 0.06;
constexpr double kComesBack = 0.30;
constexpr double kChildInside = 0.08;  // metres from the threshold to a child's back
constexpr float kChildTop = 1.15F;
constexpr double kThingHold = 0.5;            // seconds until a thing is known for one
constexpr float kThingArea = 0.25F;           // square metres of a pram's side
constexpr double kThingCertain = 1.0;         // and until there is no doubt
constexpr double kThingSure = 2.0;            // and that it takes at most half of to know better
constexpr double kSettledAcceleration = 0.4;  // m/s^1.5
constexpr double kSettles = 2.0;              // seconds at one place
constexpr double kSettledReach = 0.30;        // metres that a sitter leans
constexpr double kAnchorFollows = 3.0;        // seconds
constexpr double kThingTaller = 0.35;         // metres: who bends down is taller upright
constexpr double kPostureHold = 0.3;          // seconds a posture must last
constexpr double kCrowded = 0.8;       // metres between two people who touch with arms held out
constexpr double kHeightSlack = 0.05;  // metres: a step's rise and noise
constexpr double kSeatReach = 0.55;    // metres from a seat's centre to its sitter's torso

}  // namespace

Tracker::Tracker(const Wagon& wagon, const TrackOptions& options)
    : wagon_(wagon),
      options_(options),
      assignment_(kTracksMax, kPeopleMax),
      tracks_(kTracksMax),
      priors_(kTracksMax),
      costs_(kTracksMax * kPeopleMax),
      taken_(kPeopleMax) {}

std::span<const PersonPrior> Tracker::predict(double now_s) {
  dt_s_ = started_ ? std::max(0.0, now_s - now_s_) : 0.0;
  started_ = true;
  now_s_ = now_s;
  priors_.clear();
  for (Track& track : tracks_) {
    track.motion.predict(dt_s_, track.settled ? kSettledAcceleration : options_.acceleration);
    if (track.state == TrackState::kHidden)
      track.motion.slow_down(dt_s_, rests(track) || track.crowded ? 0.05 : 1.0);
    track.person.position = {track.motion.position().x(), track.motion.position().y()};
    if ((track.state != TrackState::kFollowed && !track.told) || track.thing) continue;
    const auto& place = track.settled ? track.anchor : track.person.position;
    const double head_top = height_is_known(track)
                                ? std::min(track.head_top, track.person.height + kHeightSlack)
                                : track.head_top;
    const PersonPrior prior{static_cast<float>(place[0]),
                            static_cast<float>(place[1]),
                            static_cast<float>(head_top),
                            track.settled,
                            track.person.posture == Posture::kLying,
                            static_cast<float>(track.person.box.yaw),
                            height_is_known(track)};
    if (!priors_.try_push_back(prior)) break;
  }
  return priors_.span();
}

void Tracker::update(std::span<const Detection> detections, std::span<const BodyShape> shapes,
                     const VisibilityGrid& visibility) {
  associate(detections);
  look_around();
  for (Track& track : tracks_) {
    if (track.detection != kNoDetection)
      see(track, detections[track.detection], shapes[track.detection]);
    else
      miss(track, visibility);
  }
  drop_doubles();
  drop_ended();
  begin(detections, shapes);
}

float Tracker::pair_cost(const Track& track, const Detection& detection) const {
  const Eigen::Vector2d position(detection.x, detection.y);
  const double away = (position - track.motion.position()).norm();
  const double spread = track.motion.position_sigma().maxCoeff();
  const double gate =
      std::clamp(3 * spread + 2 * detection.sigma, options_.gate_min_m, options_.gate_max_m);
  if (away > gate) return kImpossible;
  // What has long been a thing does not become a child who stands beside it.
  if (track.thing && track.thing_s > kThingCertain && !detection.like_a_thing &&
      detection.stands_alone)
    return kImpossible;
  const bool same_thing = track.thing && detection.like_a_thing;
  if (!track.told && now_s_ - track.person.last_seen > options_.remember_s) return kImpossible;
  if (!detection.stands_alone && !same_thing && track.state != TrackState::kFollowed &&
      !track.told && !(track.state == TrackState::kHidden && rests(track)))
    return kImpossible;
  // A part of a body is only taken for somebody's where he is.
  if (!detection.stands_alone &&
      (away > kPartReach || detection.top < kPartTopShare * track.head_top))
    return kImpossible;
  // Who was lost sight of does not live on in a pram; who bends down or falls in sight does, and he
  // who falls becomes long where he stood.
  const bool just_seen = now_s_ - track.person.last_seen < kJustSeen;
  const double stretch = std::max(kCostUnit, 0.5 * static_cast<double>(detection.length));
  if (detection.like_a_thing && !near_seat(track) && !(just_seen && away < stretch) &&
      track.person.height > detection.top + kThingTaller)
    return kImpossible;
  // Who rests stays where he is; others come to him.
  const bool resting = rests(track) && now_s_ - track.person.since > kWellKnown;
  const double unit = resting ? kRestingCostUnit : kCostUnit;
  double cost = (away / unit) * (away / unit);
  if (!detection.cut_top) {
    const double taller = (detection.top - track.head_top) / kHeightUnit;
    // Nobody grows or shrinks from one frame to the next; in hiding one may sit down.
    cost += std::min(detection.stands_alone && just_seen ? 12.0 : 4.0, taller * taller);
  }
  if (!detection.stands_alone) cost += 1;
  if (track.state == TrackState::kTentative) cost += 1;
  if (track.state == TrackState::kHidden) cost += resting ? 0.5 : 2;
  return static_cast<float>(cost);
}

void Tracker::associate(std::span<const Detection> detections) {
  costs_.resize(tracks_.size() * detections.size());
  for (std::size_t row = 0; row < tracks_.size(); ++row)
    for (std::size_t column = 0; column < detections.size(); ++column)
      costs_[row * detections.size() + column] = pair_cost(tracks_[row], detections[column]);
  const auto columns =
      assignment_.solve(costs_.span(), tracks_.size(), detections.size(), kAloneCost);
  taken_.resize(detections.size());
  for (std::uint8_t& taken : taken_) taken = 0;
  for (std::size_t row = 0; row < tracks_.size(); ++row) {
    tracks_[row].detection = columns[row] == kUnassigned ? kNoDetection : columns[row];
    if (columns[row] != kUnassigned) taken_[columns[row]] = 1;
  }
}

void Tracker::see(Track& track, const Detection& detection, const BodyShape& shape) {
  // A body that goes on beyond the image border has its centre there, too.
  // Neither do legs alone tell where the torso is.
  const bool headless = !detection.stands_alone && detection.top < track.head_top - kHeadless;
  // Nor does a part of a sitter tell where he is better than where he long was.
  const bool part_of_settled = track.settled && !detection.stands_alone;
  const double sigma = detection.sigma + (detection.cut_side ? 0.1 : 0.0) + (headless ? 0.3 : 0.0) +
                       (part_of_settled ? 0.1 : 0.0);
  track.motion.correct({detection.x, detection.y}, sigma);
  ++track.hits;
  if (detection.stands_alone || track.hits == 1) track.whole_s = now_s_;
  track.evidence += std::min(1.0, detection.area_m2 / 0.25);
  track.free_since = -1;
  track.person.last_seen = now_s_;
  if (!detection.cut_top && !headless)
    track.head_top = track.crowded && height_is_known(track)
                         ? std::min<double>(detection.top, track.person.height + kHeightSlack)
                         : detection.top;
  track.cut_side = detection.cut_side;
  measure_height(track, detection);
  judge_posture(track, detection);
  judge_thing(track, detection);
  if (track.state == TrackState::kTentative)
    confirm(track, detection);
  else
    track.state = TrackState::kFollowed;
  settle(track, detection);
  track.told = track.state == TrackState::kFollowed && !track.thing && is_inside(track);
  tell(track, shape, detection);
}

void Tracker::confirm(Track& track, const Detection& detection) {
  const bool long_enough = now_s_ - track.person.since >= options_.confirm_s - 1e-6;
  if (track.hits < options_.confirm_hits || !(long_enough || track.evidence >= kEvidenceAtOnce))
    return;
  // Of something low in a doorway only the front is seen yet: a child or a pram.
  const DepthInside depth = depth_inside(wagon_, track.person.position);
  if (depth.door >= 0 && detection.top < kChildTop &&
      depth.m < kChildInside + 0.5 * detection.length)
    return;
  // People come by the doors; what else turns up is the part of somebody rather.
  if (depth.door < 0 && !wagon_.doors.empty() &&
      now_s_ - track.person.since < options_.confirm_far_from_doors_s)
    return;
  track.thing = track.thing || detection.like_a_thing;
  Track* lost = depth.door < 0 && !track.thing ? lost_one_like(track) : nullptr;
  if (lost == nullptr) return follow(track);
  track.state = TrackState::kFollowed;
  track.person.id = lost->person.id;
  track.person.since = lost->person.since;
  track.person.height = lost->person.height;
  track.upright_s = lost->upright_s;
  track.came_in = true;
  lost->lives_on = true;
}

void Tracker::follow(Track& track) {
  track.state = TrackState::kFollowed;
  track.person.id = next_id_++;
}

// Beside somebody one may be seen with his arm or shoulder for one's own head.
void Tracker::look_around() {
  for (Track& track : tracks_) {
    track.crowded = false;
    for (const Track& other : tracks_)
      track.crowded =
          track.crowded ||
          (&other != &track && (other.person.id != 0 || other.detection != kNoDetection) &&
           distance(other.person.position, track.person.position) < kCrowded);
  }
}

// What was never seen taller and is too long for a child is a thing that came with somebody.
void Tracker::judge_thing(Track& track, const Detection& detection) const {
  const bool looks = detection.like_a_thing && !near_seat(track) &&
                     track.person.height < detection.top + kThingTaller;
  if (looks)
    track.thing_s = std::min(track.thing_s + dt_s_, kThingSure);
  else if (detection.stands_alone)
    track.thing_s = std::max(0.0, track.thing_s - 0.5 * dt_s_);
  if (detection.stands_alone && detection.top >= kChildTop) track.thing_s = 0;
  if (track.thing_s > kThingHold) track.thing = true;
  if (track.thing_s <= 0 || track.person.height > detection.top + kThingTaller) track.thing = false;
}

// Who stays at a place for long is expected there, whatever becomes of his outline when neighbours
// lean over or walk past; he leaves it as a whole.
void Tracker::settle(Track& track, const Detection& detection) const {
  const auto position = track.motion.position();
  const double away = std::hypot(position.x() - track.anchor[0], position.y() - track.anchor[1]);
  if (track.settled) {
    const bool rises = track.person.posture == Posture::kLying && detection.top > kChildTop - 0.35F;
    if (rises || (away > kSettledReach && detection.stands_alone)) {
      track.settled = false;
      track.still_since = now_s_;
    } else {
      const double share = std::min(1.0, dt_s_ / kAnchorFollows);
      track.anchor[0] += share * (position.x() - track.anchor[0]);
      track.anchor[1] += share * (position.y() - track.anchor[1]);
    }
    return;
  }
  if (track.motion.velocity().norm() > kSettledSpeed) track.still_since = now_s_;
  if (now_s_ - track.still_since < kSettles) return;
  track.settled = true;
  track.anchor = {position.x(), position.y()};
}

// Who went out by a door comes back only when clearly inside: a leaf that closes behind is nobody.
bool Tracker::is_inside(Track& track) const {
  const auto position = track.motion.position();
  const DepthInside depth = depth_inside(wagon_, {position.x(), position.y()});
  if (depth.door < 0) {
    track.came_in = true;
    return depth.m > 0;
  }
  if (depth.m > kComesBack) {
    track.came_in = true;
    track.went_out = false;
  }
  if (track.came_in && depth.m <= kDoorstep) track.went_out = true;
  return !track.went_out && depth.m > kDoorstep;
}

void Tracker::begin(std::span<const Detection> detections, std::span<const BodyShape> shapes) {
  for (std::size_t i = 0; i < detections.size(); ++i) {
    const bool thing = detections[i].like_a_thing && detections[i].area_m2 >= kThingArea;
    if (taken_[i] != 0 || !(detections[i].stands_alone || thing)) continue;
    const DepthInside depth = depth_inside(wagon_, {detections[i].x, detections[i].y});
    if (depth.door < 0 && depth.m < kThreshold) continue;
    Track track;
    track.motion = MotionFilter({detections[i].x, detections[i].y}, detections[i].sigma);
    track.person.since = now_s_;
    track.person.last_seen = now_s_;
    track.hits = 1;
    track.evidence = std::min(1.0, detections[i].area_m2 / 0.25);
    track.head_top = detections[i].top;
    track.person.height = detections[i].top;
    track.still_since = now_s_;
    track.thing = thing;
    track.thing_s = thing ? kThingHold : 0;
    track.last_tops = {detections[i].top, detections[i].top};
    track.posture_since = now_s_;
    track.whole_s = now_s_;
    track.detection = static_cast<std::uint16_t>(i);
    judge_posture(track, detections[i]);
    track.person.posture = track.posture_seen;
    tell(track, shapes[i], detections[i]);
    if (options_.confirm_hits == 1) {
      follow(track);
      track.told = true;
    }
    if (!tracks_.try_push_back(track)) ++tracks_dropped_;
  }
}

// The highest that was seen three times running; a raised hand is forgotten in some seconds of
// standing, but who sits down keeps the height of before.
void Tracker::measure_height(Track& track, const Detection& detection) const {
  constexpr double kForget = 5.0;         // seconds
  constexpr double kStillUpright = 0.25;  // metres below the height
  const double lasting =
      std::min<double>(detection.top, std::min(track.last_tops[0], track.last_tops[1]));
  track.last_tops = {detection.top, track.last_tops[0]};
  double& height = track.person.height;
  if (track.crowded && height_is_known(track)) return;  // nobody grows beside somebody
  if (detection.stands_alone && track.posture_seen == Posture::kStanding &&
      (!track.crowded || std::abs(lasting - height) < kHeightSlack))
    track.upright_s += track.crowded ? 0.5 * dt_s_ : dt_s_;
  if (lasting > height)
    height = lasting;
  else if (height - lasting < kStillUpright)
    height += std::min(1.0, dt_s_ / kForget) * (lasting - height);
}

// Sits, lies or hardly moved when last seen: is still there when it is hidden.
bool Tracker::rests(const Track& track) const {
  return track.person.posture == Posture::kSitting || track.person.posture == Posture::kLying ||
         track.posture_seen == Posture::kSitting || track.motion.velocity().norm() < kSettledSpeed;
}

bool Tracker::near_seat(const Track& track) const {
  for (const Seat& seat : wagon_.seats)
    if (distance(seat.position, track.person.position) < kSeatReach) return true;
  return false;
}

void Tracker::judge_posture(Track& track, const Detection& detection) const {
  Posture posture = Posture::kUnknown;
  const double top = detection.top;
  const double height = track.person.height;
  if (detection.cut_top) {
    posture = track.posture_seen;
  } else if ((top < 0.65 && (height > 0.9 || detection.length > 0.8)) ||
             (top < 0.9 && detection.length > 1.1)) {
    posture = Posture::kLying;
  } else if ((height > 1.35 && top < 0.82 * height && top < 1.5) ||
             (top < 1.45 && near_seat(track))) {
    posture = Posture::kSitting;
  } else if (top >= 0.8) {
    posture = Posture::kStanding;
  }
  if (posture != track.posture_seen) {
    track.posture_seen = posture;
    track.posture_since = now_s_;
  }
  if (now_s_ - track.posture_since >= kPostureHold || track.person.posture == Posture::kUnknown)
    track.person.posture = posture;
}

void Tracker::tell(Track& track, const BodyShape& shape, const Detection& detection) const {
  Person& person = track.person;
  const auto position = track.motion.position();
  const auto velocity = track.motion.velocity();
  const auto sigma = track.motion.position_sigma();
  person.position = {position.x(), position.y()};
  person.velocity = {velocity.x(), velocity.y()};
  person.sigma = {sigma.x(), sigma.y()};
  person.box = shape.box;
  person.ellipsoid = shape.ellipsoid;
  person.has_head = shape.has_head;
  person.head = shape.head;
  person.views = detection.views;
  person.has_shoulders = shape.has_shoulders;
  if (!shape.has_shoulders) return;
  // Left is where the left hand of somebody who walks this way would be; who stands keeps facing
  // the way the shoulders were told before.
  const double along_x = shape.shoulder_a[0] - shape.shoulder_b[0];
  const double along_y = shape.shoulder_a[1] - shape.shoulder_b[1];
  double side = velocity.x() * along_y - velocity.y() * along_x;
  if (velocity.norm() < 0.3)
    side = (person.shoulder_left[0] - person.shoulder_right[0]) * along_x +
           (person.shoulder_left[1] - person.shoulder_right[1]) * along_y;
  person.shoulder_left = side >= 0 ? shape.shoulder_a : shape.shoulder_b;
  person.shoulder_right = side >= 0 ? shape.shoulder_b : shape.shoulder_a;
}

}  // namespace wagonsight
