#include <algorithm>
#include <cmath>

#include "people/detect.h"
#include "people/planar.h"

// What the detector says of each part that is one person's: where, how large, seen by whom.
namespace wagonsight {
namespace {

// The visible half of an upright ellipse lies pi/4 of its half axis before its centre, seen
// horizontally: 6 cm for a head, 9 cm for a chest from the front.
constexpr float kSurfaceToCentre = 0.08F, kHeadToCentre = 0.06F;
constexpr float kHeadDepth = 0.22F;
// Head, shoulders and chest tell where the torso is; arms, legs and a sitter's lap do not. They are
// the uppermost third of who stands and also what is above the elbows of who sits.
constexpr float kTorsoShare = 0.34F, kTorsoDepthMin = 0.30F;
// Half a chest seen from one side. Of less it is not known which part is seen; the head, which is
// narrow, tells the middle better.
constexpr double kTorsoArea = 0.15;
constexpr double kHeadArea = 0.01;
constexpr double kLyingTorso = 0.35;
constexpr float kLyingToCentre = 0.04F;  // a lying body is seen from above rather
constexpr double kHeadAside = 0.30;      // metres: farther from the chest is a raised arm
// Pixels at an image border that say that a body is cut there.
constexpr std::uint32_t kCutPixels = 40;

// The area-weighted sum of places below the surface.
struct Middle {
  double area = 0, x = 0, y = 0;

  void add(const FusedPoint& p, float to_centre) {
    area += p.area_m2;
    x += p.area_m2 * (p.x + to_centre * p.away_x);
    y += p.area_m2 * (p.y + to_centre * p.away_y);
  }
};

// The torso's middle from what is seen of head and chest; the area of the result is one at most.
Middle torso_middle(const Middle& head, const Middle& torso) {
  const double hx = head.x / std::max(head.area, 1e-9), hy = head.y / std::max(head.area, 1e-9);
  const double tx = torso.x / std::max(torso.area, 1e-9);
  const double ty = torso.y / std::max(torso.area, 1e-9);
  const bool has_head = head.area >= kHeadArea || torso.area <= 0;
  const bool aside = torso.area > 0 && distance_between(hx, hy, tx, ty) > kHeadAside;
  double by_torso = std::min(1.0, torso.area / kTorsoArea);
  if (!has_head || aside) by_torso = 1;
  return {1, by_torso * tx + (1 - by_torso) * hx, by_torso * ty + (1 - by_torso) * hy};
}

}  // namespace

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
    double all = 0, ax = 0, ay = 0, xx = 0, xy = 0, yy = 0, sigma = 0;
    Middle head, torso;
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
    const float below = detection.top - p.z;
    if (below < kHeadDepth) {
      s.head.add(p, kHeadToCentre);
      s.sigma += p.area_m2 * p.sigma;
    } else if (below < std::max(kTorsoDepthMin, kTorsoShare * detection.top)) {
      s.torso.add(p, kSurfaceToCentre);
      s.sigma += p.area_m2 * p.sigma;
    }
  }
  for (std::size_t i = 0; i < detections_.size(); ++i) {
    Detection& detection = detections_[i];
    const Sums& s = sums[i];
    const Middle middle = torso_middle(s.head, s.torso);
    detection.x = static_cast<float>(middle.x / middle.area);
    detection.y = static_cast<float>(middle.y / middle.area);
    detection.sigma =
        static_cast<float>(0.04 + 0.5 * s.sigma / std::max(s.head.area + s.torso.area, 1e-9));
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
    if (detection.top < kLyingTop && detection.length > options_.lying_length_min_m)
      find_lying_torso(cloud, static_cast<std::uint16_t>(i));
  }
}

// The torso is where most of a lying body's surface is: a mean shift over half a torso's length
// (Comaniciu and Meer 2002) leaves the legs behind.
void Detector::find_lying_torso(const FusedCloud& cloud, std::uint16_t index) {
  constexpr int kSteps = 6;
  Detection& detection = detections_[index];
  for (int step = 0; step < kSteps; ++step) {
    Middle middle;
    for (std::size_t i = 0; i < cloud.points.size(); ++i)
      if (labels_[i] == index && distance_between(cloud.points[i].x, cloud.points[i].y, detection.x,
                                                  detection.y) < kLyingTorso)
        middle.add(cloud.points[i], kLyingToCentre);
    if (middle.area <= 0) return;
    detection.x = static_cast<float>(middle.x / middle.area);
    detection.y = static_cast<float>(middle.y / middle.area);
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
