#include <algorithm>
#include <cmath>

#include "people/detect.h"
#include "people/planar.h"

// People on the floor: they are long, and their outlines join those of whoever is beside them.
namespace wagonsight {
namespace {

constexpr double kLyingPartLength = 0.6;  // longer than a foot in a stride
constexpr double kLegsReach = 0.18;       // metres: legs that stand are rather nearer to the head
// Nothing of one who gets down on the floor or up from it is higher when his outline is long.
constexpr float kLowTop = 1.0F;
constexpr double kSideBySide = 1.7;  // metres between two who lie and whose outlines can be one
// Of a lying body's surface, standard deviations in metres.
constexpr double kHalfLong = 0.42, kHalfWide = 0.13;
constexpr double kBodyReach2 = 7.0;  // in those, squared: 1.1 m along it, 0.35 m across
constexpr double kLeast = 0.08;      // metres: nobody is flatter

}  // namespace

// The surface of one who lies: an elongated cloud on the floor.
struct Detector::LyingBody {
  double x = 0, y = 0, xx = 0, xy = 0, yy = 0;  // middle and covariance
  double area = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;

  void expect(const PersonPrior& prior) {
    x = prior.x;
    y = prior.y;
    const double c = std::cos(prior.yaw), s = std::sin(prior.yaw);
    const double along = square(kHalfLong), across = square(kHalfWide);
    xx = along * c * c + across * s * s;
    xy = (along - across) * c * s;
    yy = along * s * s + across * c * c;
  }
  double determinant() const { return xx * yy - xy * xy; }
  // Squared Mahalanobis distance.
  double distance(double px, double py) const {
    const double dx = px - x, dy = py - y;
    return (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / determinant();
  }
  double unlikeliness(double px, double py) const {
    return distance(px, py) + std::log(determinant());
  }
  void add(const FusedPoint& p) {
    area += p.area_m2;
    sx += p.area_m2 * p.x;
    sy += p.area_m2 * p.y;
    sxx += p.area_m2 * p.x * p.x;
    sxy += p.area_m2 * p.x * p.y;
    syy += p.area_m2 * p.y * p.y;
  }
  void renew() {
    if (area > 0) {
      x = sx / area;
      y = sy / area;
      xx = sxx / area - x * x + kLeast * kLeast;
      xy = sxy / area - x * y;
      yy = syy / area - y * y + kLeast * kLeast;
    }
    area = sx = sy = sxx = sxy = syy = 0;
  }
};

// Parts that two lying people share, or that lie about between them, are told apart by the bodies'
// own long shapes: from where each was at the last instant a mixture of ellipses is fitted, every
// point to the likeliest (classification EM, Celeux and Govaert 1992).
void Detector::split_lying(const FusedCloud& cloud, std::span<const PersonPrior> priors) {
  constexpr int kSteps = 4;
  constexpr std::size_t kLyingMax = 4;
  FixedVector<LyingBody, kLyingMax> bodies;
  FixedVector<std::size_t, kLyingMax> members;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const PersonPrior& prior = priors[i];
    if (places_[i].part == kNoDetection || prior.head_top > kLowTop) continue;
    if (!prior.lying && parts_[places_[i].part].length() < kLyingPartLength) continue;
    const bool far = !members.empty() && distance_between(prior.x, prior.y, priors[members[0]].x,
                                                          priors[members[0]].y) > kSideBySide;
    if (far || !members.try_push_back(i)) continue;
    LyingBody body;
    body.expect(prior);
    bodies.push_back(body);
  }
  if (members.size() < 2 || parts_.size() + members.size() > parts_.capacity()) return;
  crowns_.clear();  // here: the points of all these parts
  for (std::size_t k = 0; k < cloud.points.size(); ++k) {
    if (part_labels_[k] == kNoSegment) continue;
    const std::uint16_t part = part_root(part_labels_[k]);
    bool theirs = false;
    for (const std::size_t member : members)
      theirs = theirs || places_[member].part == part ||
               (parts_[part].top < kLyingTop &&
                distance_between(parts_[part].mean_x(), parts_[part].mean_y(), priors[member].x,
                                 priors[member].y) < kLyingReach);
    if (!theirs || parts_[part].top > kLowTop) continue;
    crowns_.resize(crowns_.size() + 1);
    crowns_[crowns_.size() - 1] = static_cast<std::uint32_t>(k);
  }
  const auto likeliest = [&](const FusedPoint& p) {
    std::size_t best = 0;
    for (std::size_t i = 1; i < bodies.size(); ++i)
      if (bodies[i].unlikeliness(p.x, p.y) < bodies[best].unlikeliness(p.x, p.y)) best = i;
    return best;
  };
  for (int step = 0; step < kSteps; ++step) {
    for (const std::uint32_t k : crowns_) bodies[likeliest(cloud.points[k])].add(cloud.points[k]);
    for (LyingBody& body : bodies) body.renew();
  }
  const std::size_t first = parts_.size();
  for (std::size_t i = 0; i < bodies.size(); ++i) add_empty_part();
  for (const std::uint32_t k : crowns_) {
    const std::size_t best = likeliest(cloud.points[k]);
    parts_[part_root(part_labels_[k])].area = 0;
    part_labels_[k] = static_cast<std::uint16_t>(first + best);
    add_point(parts_[first + best], cloud.points[k]);
  }
  for (std::size_t i = 0; i < members.size(); ++i)
    places_[members[i]].part = static_cast<std::uint16_t>(first + i);
}

// The feet of a helper touch the one on the floor. What is as low and lies where he is expected,
// beyond the reach of the upright one's legs, is his.
bool Detector::split_off_lying(const FusedCloud& cloud, std::size_t index,
                               std::span<const PersonPrior> priors) {
  const float top_x = parts_[index].top_x, top_y = parts_[index].top_y;
  for (const PersonPrior& prior : priors) {
    if (!prior.lying || parts_.size() + 2 > parts_.capacity()) continue;
    if (parts_[index].top < prior.head_top + kRisesAtOnce) continue;
    LyingBody his;
    his.expect(prior);
    const auto is_his = [&](std::size_t k) {
      const FusedPoint& p = cloud.points[k];
      const double legs = distance_between(p.x, p.y, top_x, top_y) / kLegsReach;
      return p.z < kLyingTop - 0.1F && is_in(k, index) &&
             his.distance(p.x, p.y) < std::min(kBodyReach2, square(legs));
    };
    Part body;
    body.area = 1e-9;
    for (std::size_t k = 0; k < cloud.points.size(); ++k)
      if (is_his(k)) add_point(body, cloud.points[k]);
    if (body.area < options_.area_min_m2 || body.length() < kLyingPartLength) continue;
    const std::size_t first = parts_.size();
    add_empty_part();
    add_empty_part();
    for (std::size_t k = 0; k < cloud.points.size(); ++k) {
      if (!is_in(k, index)) continue;
      const std::size_t side = is_his(k) ? 1 : 0;
      part_labels_[k] = static_cast<std::uint16_t>(first + side);
      add_point(parts_[first + side], cloud.points[k]);
    }
    parts_[index].area = 0;
    return true;
  }
  return false;
}

}  // namespace wagonsight
