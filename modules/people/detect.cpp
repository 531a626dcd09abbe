#include "people/detect.h"

#include <algorithm>
#include <cmath>

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
constexpr double kPriorReach = 0.7;     // from the middle of a hill to those expected in it
constexpr double kExpectedApart = 0.2;  // nearer tracks follow one person
// The heads of people whose heights differ by a head's length are in this band below the highest.
constexpr float kHeadBand = 0.35F;
// How much fainter than the fainter of two heads the place between them is: clearly when nobody
// was expected, slightly when two people were.
constexpr float kClearGap = 0.65F, kSlightGap = 0.90F;
// The visible half of an upright ellipse lies pi/4 of its half axis before its centre, seen
// horizontally: 6 cm for a head, 9 cm for a chest from the front.
constexpr float kSurfaceToCentre = 0.08F;
// Head, shoulders and chest tell where the torso is; arms and legs swing.
constexpr float kTorsoDepth = 0.60F;
// Pixels at an image border that say that a body is cut there.
constexpr std::uint32_t kCutPixels = 40;

double square(double value) {
  return value * value;
}

double distance_between(double ax, double ay, double bx, double by) {
  return std::sqrt(square(ax - bx) + square(ay - by));
}

}  // namespace

Detector::Detector(const Bounds& inside, const DetectOptions& options)
    : options_(options),
      segments_(inside),
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

bool Detector::same_person(const Part& high, const Part& low,
                           std::span<const PersonPrior> priors) const {
  const double between = distance_between(high.mean_x(), high.mean_y(), low.mean_x(), low.mean_y());
  const double tops = distance_between(high.top_x, high.top_y, low.top_x, low.top_y);
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
  const std::size_t count = parts_.size();
  for (std::size_t i = 0; i < count; ++i) {
    const Part& part = parts_[i];
    if (part.merged_into != i || part.area < 2 * options_.area_part_min_m2) continue;
    expect_in(i, priors);
    const double length = part.length();
    if (expected_.size() < 2 && (length < kOnePersonLength || part.area < options_.area_min_m2))
      continue;
    head_modes_.clear(static_cast<float>(part.mean_x()), static_cast<float>(part.mean_y()));
    for (std::size_t k = 0; k < cloud.points.size(); ++k)
      if (is_in(k, i) && cloud.points[k].z > part.top - kHeadBand) head_modes_.add(cloud.points[k]);
    const auto heads = head_modes_.find(expected_.size() < 2 ? kClearGap : kSlightGap);
    std::array<HeadMode, 2> pair{};
    if (!heads.empty()) pair[0] = heads[0];
    if (heads.size() > 1)
      split(cloud, i, heads);
    else if (!heads.empty() && length >= kOnePersonLength &&
             find_child_beside(cloud, i, pair[0], pair[1]))
      split(cloud, i, pair);
    else if (expected_.size() > 1 && all_settled_ && length >= kOnePersonLength)
      split(cloud, i, {expected_.data(), expected_.size()});
  }
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
    if (!expected_.try_push_back({priors[i].x, priors[i].y, places_[i].support_m2})) break;
    all_settled_ = all_settled_ && priors[i].settled;
  }
}

// Every point goes to the nearest head. Parts that were merged into this one dissolve.
void Detector::split(const FusedCloud& cloud, std::size_t part, std::span<const HeadMode> heads) {
  const std::size_t first = parts_.size();
  if (first + heads.size() > parts_.capacity()) return;
  for (std::size_t head = 0; head < heads.size(); ++head) {
    Part fresh;
    fresh.bottom = 1e9F;
    fresh.area = 1e-9;
    fresh.merged_into = static_cast<std::uint16_t>(first + head);
    if (!parts_.try_push_back(fresh)) return;
  }
  for (std::size_t k = 0; k < cloud.points.size(); ++k) {
    if (!is_in(k, part)) continue;
    const FusedPoint& p = cloud.points[k];
    std::size_t nearest = 0;
    for (std::size_t head = 1; head < heads.size(); ++head)
      if (distance_between(p.x, p.y, heads[head].x, heads[head].y) <
          distance_between(p.x, p.y, heads[nearest].x, heads[nearest].y))
        nearest = head;
    part_labels_[k] = static_cast<std::uint16_t>(first + nearest);
    add_point(parts_[first + nearest], p);
  }
  parts_[part].area = 0;
}

void Detector::measure(const FusedCloud& cloud) {
  detections_.clear();
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    Part& part = parts_[i];
    if (part.merged_into != i || part.area < options_.area_part_min_m2) continue;
    Detection detection;
    detection.top = part.top;
    detection.bottom = part.bottom;
    detection.area_m2 = static_cast<float>(part.area);
    detection.points = part.points;
    if (!detections_.try_push_back(detection)) break;
    part.detection = static_cast<std::uint16_t>(detections_.size() - 1);
  }
  labels_.resize(cloud.points.size());
  for (std::size_t i = 0; i < cloud.points.size(); ++i)
    labels_[i] =
        part_labels_[i] == kNoSegment ? kNoDetection : parts_[part_root(part_labels_[i])].detection;
  measure_positions(cloud);
  add_views(cloud);
  judge();
}

void Detector::measure_positions(const FusedCloud& cloud) {
  struct Sums {
    double area = 0, x = 0, y = 0, sigma = 0;
    double all = 0, ax = 0, ay = 0, xx = 0, xy = 0, yy = 0;
  };
  std::array<Sums, kPeopleMax> sums{};
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    if (labels_[i] == kNoDetection) continue;
    const FusedPoint& p = cloud.points[i];
    const Detection& detection = detections_[labels_[i]];
    Sums& s = sums[labels_[i]];
    const double x = p.x + kSurfaceToCentre * p.away_x;
    const double y = p.y + kSurfaceToCentre * p.away_y;
    s.all += p.area_m2;
    s.ax += p.area_m2 * x;
    s.ay += p.area_m2 * y;
    s.xx += p.area_m2 * x * x;
    s.xy += p.area_m2 * x * y;
    s.yy += p.area_m2 * y * y;
    if (p.z < detection.top - kTorsoDepth) continue;
    s.area += p.area_m2;
    s.x += p.area_m2 * x;
    s.y += p.area_m2 * y;
    s.sigma += p.area_m2 * p.sigma;
  }
  for (std::size_t i = 0; i < detections_.size(); ++i) {
    Detection& detection = detections_[i];
    const Sums& s = sums[i];
    const double area = std::max(s.area, 1e-9);
    detection.x = static_cast<float>(s.x / area);
    detection.y = static_cast<float>(s.y / area);
    detection.sigma = static_cast<float>(0.04 + 0.5 * s.sigma / area);
    const double mx = s.ax / s.all;
    const double my = s.ay / s.all;
    const double xx = std::max(0.0, s.xx / s.all - mx * mx);
    const double yy = std::max(0.0, s.yy / s.all - my * my);
    const double xy = s.xy / s.all - mx * my;
    const double half = 0.5 * (xx + yy);
    const double root = std::sqrt(square(0.5 * (xx - yy)) + xy * xy);
    // sqrt(12): the extent of a uniform distribution with that variance.
    detection.length = static_cast<float>(std::sqrt(12 * (half + root)));
    detection.width = static_cast<float>(std::sqrt(12 * std::max(0.0, half - root)));
  }
}

void Detector::add_views(const FusedCloud& cloud) {
  for (const Contribution& c : cloud.contributions) {
    if (labels_[c.point] == kNoDetection) continue;
    Detection& detection = detections_[labels_[c.point]];
    ViewAttributes* view = nullptr;
    for (ViewAttributes& candidate : detection.views)
      if (candidate.sensor_index == c.sensor) view = &candidate;
    if (view == nullptr) {
      ViewAttributes fresh;
      fresh.sensor_index = c.sensor;
      fresh.image_box = {c.u, c.v, c.u, c.v};
      detection.views.push_back(fresh);
      view = &detection.views.back();
    }
    Detection::Cut& cut = detection.cuts[static_cast<std::size_t>(view - detection.views.begin())];
    if ((c.borders & kTop) != 0) cut.top += c.pixels;
    if ((c.borders & (kLeft | kRight)) != 0) cut.side += c.pixels;
    view->pixels += c.pixels;
    view->image_box[0] = std::min<int>(view->image_box[0], c.u);
    view->image_box[1] = std::min<int>(view->image_box[1], c.v);
    view->image_box[2] = std::max<int>(view->image_box[2], c.u);
    view->image_box[3] = std::max<int>(view->image_box[3], c.v);
    view->distance += c.depth * static_cast<float>(c.pixels);
  }
  for (Detection& detection : detections_)
    for (ViewAttributes& view : detection.views)
      view.distance /= static_cast<float>(std::max(1U, view.pixels));
}

void Detector::judge() {
  for (Detection& detection : detections_) {
    // Cut only when no view shows the whole.
    detection.cut_top = detection.cut_side = !detection.views.empty();
    for (std::size_t i = 0; i < detection.views.size(); ++i) {
      detection.cut_top = detection.cut_top && detection.cuts[i].top >= kCutPixels;
      detection.cut_side = detection.cut_side && detection.cuts[i].side >= kCutPixels;
    }
    const float tall = detection.top - detection.bottom;
    const bool solid = detection.area_m2 >= options_.solid_min * tall * detection.length;
    const bool upright = detection.top >= options_.standing_min_m &&
                         detection.area_m2 >= options_.area_min_m2 && tall >= 0.3F && solid;
    const bool slim =
        detection.top >= options_.child_max_m ||
        (detection.length <= options_.child_length_max_m &&
         detection.width <= options_.child_width_max_m && tall >= options_.child_tall_min_m &&
         detection.bottom <= options_.child_bottom_max_m &&
         detection.area_m2 >= options_.child_area_min_m2);
    const bool lying = detection.top < options_.standing_min_m &&
                       detection.area_m2 >= options_.lying_area_min_m2 &&
                       detection.length >= options_.lying_length_min_m;
    detection.like_a_thing = upright && !slim &&
                             (detection.length > options_.child_length_max_m ||
                              detection.width > options_.child_width_max_m);
    detection.stands_alone = (upright && slim) || lying;
  }
}

}  // namespace wagonsight
