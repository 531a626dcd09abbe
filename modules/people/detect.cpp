#include "people/detect.h"

#include <algorithm>
#include <cmath>

#include "people/planar.h"

namespace wagonsight {
namespace {

constexpr std::size_t kPartsMax = 1024;
// Nobody stands closer to somebody than half a shoulder's width.
constexpr double kTogetherMax = 0.28;
// Between two people whose heads were told apart; closer ones need a track's word.
constexpr double kApartMin = 0.40;
// A part that is no person by itself belongs to the nearest one within arm's reach.
constexpr double kPartReach = 0.60;
constexpr double kAdultRadius = 0.3;  // metres: shoulders
// Longer than anybody with a bag, seen as an even spread of surface.
constexpr double kOnePersonLength = 0.62;
constexpr double kExpectedApart = 0.2;  // nearer tracks follow one person
// The heads of people whose heights differ by a head's length are in this band below the highest.
constexpr float kHeadBand = 0.35F;
// Where a track expects its head: about its centre, a hand's breadth below the top.
constexpr float kHeadBelow = 0.08F, kHeadReach = 0.14F;
constexpr float kHeadTopSlack = 0.10F;
constexpr float kHeadDeep = 0.25F;           // metres: a head and its neck
constexpr double kHeadStrays = 0.30;         // metres from where it is expected
constexpr float kExpectedHeadArea = 0.012F;  // square metres: a third of a head seen from one side
constexpr double kTooHigh = 1.0;  // metres that a point above somebody's head is farther from him
// How much fainter than the fainter of two heads the place between them is: clearly when nobody
// was expected, slightly when two people were.
constexpr float kClearGap = 0.65F, kSlightGap = 0.90F;
}  // namespace

Detector::Detector(const Bounds& inside, const DetectOptions& options)
    : options_(options),
      segments_(inside),
      crowns_(kFusedPointsMax),
      parts_(kPartsMax),
      part_labels_(kFusedPointsMax),
      labels_(kFusedPointsMax),
      detections_(kPeopleMax) {}

std::span<const Detection> Detector::detect(const FusedCloud& cloud,
                                            std::span<const PersonPrior> priors) {
  segments_.segment(cloud);
  gather_parts(cloud);
  merge_parts(priors);
  split_crowds(cloud, priors);
  measure(cloud);
  return detections_.span();
}

std::uint16_t Detector::part_root(std::uint16_t part) const {
  while (parts_[part].merged_into != part) part = parts_[part].merged_into;
  return part;
}

void Detector::gather_parts(const FusedCloud& cloud) {
  parts_.clear();
  const std::size_t count = std::min(segments_.count(), kPartsMax / 2);  // the rest is for splits
  for (std::size_t i = 0; i < count; ++i) {
    Part part;
    part.bottom = 1e9F;
    part.merged_into = static_cast<std::uint16_t>(i);
    if (!parts_.try_push_back(part)) break;
  }
  part_labels_.resize(cloud.points.size());
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    std::uint16_t label = segments_.labels()[i];
    if (label != kNoSegment && label >= count) label = kNoSegment;
    part_labels_[i] = label;
    if (label == kNoSegment) continue;
    add_point(parts_[label], cloud.points[i]);
  }
  for (Part& part : parts_) part.area = std::max(part.area, 1e-9);
}

void Detector::add_point(Part& part, const FusedPoint& p) const {
  const double area = p.area_m2;
  part.area += area;
  part.x += area * p.x;
  part.y += area * p.y;
  part.xx += area * square(p.x);
  part.xy += area * p.x * p.y;
  part.yy += area * square(p.y);
  if (p.z > part.top) {
    part.top = p.z;
    part.top_x = p.x;
    part.top_y = p.y;
  }
  part.bottom = std::min(part.bottom, p.z);
  ++part.points;
}

double Detector::Part::length() const {
  const double vx = std::max(0.0, xx / area - square(mean_x()));
  const double vy = std::max(0.0, yy / area - square(mean_y()));
  const double vxy = xy / area - mean_x() * mean_y();
  return std::sqrt(12 * (0.5 * (vx + vy) + std::hypot(0.5 * (vx - vy), vxy)));
}

void Detector::merge(std::size_t low, std::size_t high) {
  Part& from = parts_[low];
  Part& to = parts_[high];
  to.area += from.area;
  to.x += from.x;
  to.y += from.y;
  to.xx += from.xx;
  to.xy += from.xy;
  to.yy += from.yy;
  to.bottom = std::min(to.bottom, from.bottom);
  to.points += from.points;
  from.merged_into = static_cast<std::uint16_t>(high);
}

// Who bends over somebody on the floor or stands beside him is another one.
bool Detector::lies_there(const Part& low, const Part& high,
                          std::span<const PersonPrior> priors) const {
  for (const PersonPrior& prior : priors)
    if (prior.lying && high.top >= prior.head_top + kRisesAtOnce &&
        distance_between(prior.x, prior.y, low.mean_x(), low.mean_y()) < 0.7 * kLyingReach)
      return true;
  return false;
}

bool Detector::same_person(const Part& high, const Part& low,
                           std::span<const PersonPrior> priors) const {
  const double between = distance_between(high.mean_x(), high.mean_y(), low.mean_x(), low.mean_y());
  if (low.top < kLyingTop && high.top >= kLyingTop && lies_there(low, high, priors)) return false;
  const double tops = distance_between(high.top_x, high.top_y, low.top_x, low.top_y);
  // Who lies is long.
  if (high.top < kLyingTop && between < kLyingReach) return true;
  if (between > kPartReach) return false;
  if (std::min(between, tops) < kTogetherMax) return true;
  // Two who have long sat or stood here are two, however little of one is seen.
  if (low.area >= options_.area_part_min_m2) {
    bool low_expected = false;
    bool high_expected = false;
    for (const PersonPrior& prior : priors) {
      if (!prior.settled) continue;
      const double to_high = distance_between(prior.x, prior.y, high.mean_x(), high.mean_y());
      const double to_low = distance_between(prior.x, prior.y, low.mean_x(), low.mean_y());
      if (std::min(to_high, to_low) > kApartMin) continue;
      (to_low < to_high ? low_expected : high_expected) = true;
    }
    if (low_expected && high_expected) return false;
  }
  const bool low_is_person = low.area >= options_.area_min_m2 &&
                             low.top >= options_.standing_min_m && low.top - low.bottom > 0.35F;
  if (!low_is_person) return true;
  if (std::max(between, tops) >= kApartMin) return false;
  // In doubt the tracks decide: two people expected here are two.
  int expected = 0;
  for (const PersonPrior& prior : priors) {
    const double to_high = distance_between(prior.x, prior.y, high.mean_x(), high.mean_y());
    const double to_low = distance_between(prior.x, prior.y, low.mean_x(), low.mean_y());
    if (std::min(to_high, to_low) < kApartMin) ++expected;
  }
  return expected < 2;
}

// Lowest first, so that an arm joins its shoulder before two shoulders are compared.
void Detector::merge_parts(std::span<const PersonPrior> priors) {
  for (std::size_t low = parts_.size(); low-- > 1;) {
    std::size_t best = low;
    double best_distance = 0;
    for (std::size_t high = 0; high < low; ++high) {
      if (!same_person(parts_[high], parts_[low], priors)) continue;
      const double distance = distance_between(parts_[high].mean_x(), parts_[high].mean_y(),
                                               parts_[low].mean_x(), parts_[low].mean_y());
      if (best != low && distance >= best_distance) continue;
      best = high;
      best_distance = distance;
    }
    if (best != low) merge(low, best);
  }
}

// A hill that is too long for one person, or in which the tracks expect two, is split where several
// heads stand out; failing that, between those who are
// expected there because they sit or stand there: walkers are told apart by their heads alone, or a
// track gone wrong would live on in another one's arms and legs.
void Detector::split_crowds(const FusedCloud& cloud, std::span<const PersonPrior> priors) {
  place_priors(cloud, priors);
  join_mixed_up(priors);
  const std::size_t count = parts_.size();
  split_lying(cloud, priors);
  for (std::size_t i = 0; i < count; ++i) {
    const Part& part = parts_[i];
    if (part.merged_into != i || part.area < 2 * options_.area_part_min_m2) continue;
    if (part.top < kLyingTop || split_off_lying(cloud, i, priors)) continue;
    expect_in(i, priors);
    const double length = part.length();
    // The flat top of a pram is full of heads; children are told apart by their hills or tracks.
    if (expected_.size() < 2 && part.top < options_.child_max_m) continue;
    if (expected_.size() < 2 && (length < kOnePersonLength || part.area < options_.area_min_m2))
      continue;
    find_centres(cloud, i);
    std::array<HeadMode, 2> pair{};
    if (!centres_.empty()) pair[0] = centres_[0];
    if (centres_.size() > 1)
      split(cloud, i, {centres_.data(), centres_.size()});
    else if (!centres_.empty() && length >= kOnePersonLength &&
             find_child_beside(cloud, i, pair[0], pair[1]))
      split(cloud, i, pair);
  }
}

// What has nothing above it: heads, shoulders and arms that are held out.
void Detector::gather_crowns(const FusedCloud& cloud, std::size_t index) {
  crowns_.clear();
  for (std::size_t k = 0; k < cloud.points.size(); ++k) {
    const float z = cloud.points[k].z;
    if (z < kLyingTop || !is_in(k, index) || z < segments_.top_over(k) - kHeadDeep) continue;
    crowns_.resize(crowns_.size() + 1);
    crowns_[crowns_.size() - 1] = static_cast<std::uint32_t>(k);
  }
}

// People keep their height: a track's head is where, near the expected place, something is as high
// as that and nothing is higher. A mean shift goes there (Comaniciu and Meer 2002).
void Detector::find_expected_heads(const FusedCloud& cloud) {
  constexpr int kSteps = 5;
  for (Expected& person : expected_) {
    float x = person.x;
    float y = person.y;
    for (int step = 0; step < kSteps; ++step) {
      float area = 0, sum_x = 0, sum_y = 0;
      for (const std::uint32_t k : crowns_) {
        const FusedPoint& p = cloud.points[k];
        if (std::abs(p.z - person.head_top + kHeadBelow) > kHeadReach ||
            segments_.top_over(k) > person.head_top + kHeadTopSlack ||
            distance_between(p.x, p.y, x, y) > kHeadReach)
          continue;
        area += p.area_m2;
        sum_x += p.area_m2 * p.x;
        sum_y += p.area_m2 * p.y;
      }
      person.head_area_m2 = area;
      if (area <= 0) break;
      x = sum_x / area;
      y = sum_y / area;
    }
    if (distance_between(x, y, person.x, person.y) > kHeadStrays) person.head_area_m2 = 0;
    if (person.head_area_m2 < kExpectedHeadArea) continue;
    person.x = x;
    person.y = y;
  }
}

bool Detector::is_centre(double x, double y) const {
  for (const HeadMode& centre : centres_)
    if (distance_between(centre.x, centre.y, x, y) < kTogetherMax) return true;
  return false;
}

// The heads of one hill: those that tracks expect and that are there, and others that stand out
// clearly; among people who have long sat or stood together all who are expected.
void Detector::find_centres(const FusedCloud& cloud, std::size_t index) {
  const Part& part = parts_[index];
  head_modes_.clear(static_cast<float>(part.mean_x()), static_cast<float>(part.mean_y()));
  gather_crowns(cloud, index);
  for (const std::uint32_t k : crowns_)
    if (cloud.points[k].z > part.top - kHeadBand) head_modes_.add(cloud.points[k]);
  const auto heads = head_modes_.find(expected_.size() < 2 ? kClearGap : kSlightGap);
  centres_.clear();
  if (expected_.size() > std::max<std::size_t>(heads.size(), 1) && all_settled_ &&
      part.length() >= kOnePersonLength) {
    for (const Expected& person : expected_)
      if (!centres_.try_push_back(person)) break;
    return;
  }
  if (expected_.size() >= 2) {
    find_expected_heads(cloud);
    for (const Expected& person : expected_)
      if (person.head_area_m2 >= kExpectedHeadArea && !is_centre(person.x, person.y) &&
          !centres_.try_push_back(person))
        break;
  }
  for (const HeadMode& head : heads)
    if (!is_centre(head.x, head.y) && !centres_.try_push_back(head)) break;
}

// A child's head is lower than the band in which an adult's shows. What is left of the hill beyond
// an adult's reach is a child when it has the shape of one.
bool Detector::find_child_beside(const FusedCloud& cloud, std::size_t part, HeadMode& adult,
                                 HeadMode& child) const {
  Part rest;
  rest.bottom = 1e9F;
  rest.area = 1e-9;
  for (std::size_t k = 0; k < cloud.points.size(); ++k)
    if (is_in(k, part) &&
        distance_between(cloud.points[k].x, cloud.points[k].y, adult.x, adult.y) > kAdultRadius)
      add_point(rest, cloud.points[k]);
  if (rest.area < 2 * options_.area_min_m2 || rest.top < options_.standing_min_m ||
      rest.top - rest.bottom < options_.child_tall_min_m ||
      rest.length() > options_.child_length_max_m ||
      distance_between(rest.mean_x(), rest.mean_y(), adult.x, adult.y) < kAdultRadius + 0.05)
    return false;
  child = {static_cast<float>(rest.mean_x()), static_cast<float>(rest.mean_y()), 0};
  return true;
}

bool Detector::is_in(std::size_t point, std::size_t part) const {
  return part_labels_[point] != kNoSegment && part_root(part_labels_[point]) == part;
}

// The part that has most of its surface where a track expects somebody is where it belongs.
void Detector::place_priors(const FusedCloud& cloud, std::span<const PersonPrior> priors) {
  struct Share {
    std::uint16_t part = 0;
    float area_m2 = 0;
  };
  places_.clear();
  for (const PersonPrior& prior : priors) {
    FixedVector<Share, 8> shares;
    for (std::size_t k = 0; k < cloud.points.size(); ++k) {
      const FusedPoint& p = cloud.points[k];
      if (std::abs(p.x - prior.x) > kTogetherMax || std::abs(p.y - prior.y) > kTogetherMax)
        continue;
      if (part_labels_[k] == kNoSegment) continue;
      const std::uint16_t part = part_root(part_labels_[k]);
      std::size_t at = 0;
      while (at < shares.size() && shares[at].part != part) ++at;
      if (at == shares.size() && !shares.try_push_back({part, 0})) continue;
      shares[at].area_m2 += p.area_m2;
    }
    Place place;
    for (const Share& share : shares)
      if (share.area_m2 > place.support_m2) place = {share.part, share.area_m2};
    if (!places_.try_push_back(place)) break;
  }
}

// Where a part is higher than the person in it, a neighbour's arm or shoulder is in it, too: the
// two are joined, to be told apart by their heads.
void Detector::join_mixed_up(std::span<const PersonPrior> priors) {
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const std::uint16_t low = places_[i].part;
    if (!priors[i].known || low == kNoDetection || priors[i].head_top < kLyingTop ||
        parts_[low].top < priors[i].head_top + kHeadTopSlack)
      continue;
    std::size_t best = i;
    double best_m = kPartReach;
    for (std::size_t j = 0; j < places_.size(); ++j) {
      const double away = distance_between(priors[i].x, priors[i].y, priors[j].x, priors[j].y);
      if (places_[j].part == kNoDetection || places_[j].part == low || away >= best_m ||
          priors[j].head_top + kHeadTopSlack < parts_[low].top)
        continue;
      best = j;
      best_m = away;
    }
    if (best == i) continue;
    const std::uint16_t high = places_[best].part;
    merge(low, high);
    parts_[high].top = std::max(parts_[high].top, parts_[low].top);
    for (Place& place : places_)
      if (place.part == low) place.part = high;
  }
}

void Detector::expect_in(std::size_t part, std::span<const PersonPrior> priors) {
  expected_.clear();
  all_settled_ = true;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (places_[i].part != part || places_[i].support_m2 < options_.area_part_min_m2) continue;
    bool apart = true;
    for (const HeadMode& other : expected_)
      apart =
          apart && distance_between(other.x, other.y, priors[i].x, priors[i].y) >= kExpectedApart;
    if (!apart) continue;
    const HeadMode place{priors[i].x, priors[i].y, places_[i].support_m2,
                         priors[i].head_top + kHeadTopSlack};
    if (!expected_.try_push_back({place, priors[i].head_top, 0})) break;
    all_settled_ = all_settled_ && priors[i].settled;
  }
}

// There must be room.
void Detector::add_empty_part() {
  Part fresh;
  fresh.bottom = 1e9F;
  fresh.area = 1e-9;
  fresh.merged_into = static_cast<std::uint16_t>(parts_.size());
  (void)parts_.try_push_back(fresh);
}

// Every point goes to the nearest head. Parts that were merged into this one dissolve.
void Detector::split(const FusedCloud& cloud, std::size_t part, std::span<const HeadMode> heads) {
  const std::size_t first = parts_.size();
  if (first + heads.size() > parts_.capacity()) return;
  for (std::size_t head = 0; head < heads.size(); ++head) add_empty_part();
  for (std::size_t k = 0; k < cloud.points.size(); ++k) {
    if (!is_in(k, part)) continue;
    const FusedPoint& p = cloud.points[k];
    std::size_t nearest = 0;
    double nearest_m = 1e9;
    for (std::size_t head = 0; head < heads.size(); ++head) {
      const double away = distance_between(p.x, p.y, heads[head].x, heads[head].y) +
                          (p.z > heads[head].top ? kTooHigh : 0.0);
      if (away >= nearest_m) continue;
      nearest = head;
      nearest_m = away;
    }
    part_labels_[k] = static_cast<std::uint16_t>(first + nearest);
    add_point(parts_[first + nearest], p);
  }
  parts_[part].area = 0;
}

}  // namespace wagonsight
