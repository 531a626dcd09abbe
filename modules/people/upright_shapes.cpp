#include "people/upright_shapes.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

constexpr std::uint32_t kDropped = UINT32_MAX;
constexpr std::uint32_t kKept = UINT32_MAX - 1;
constexpr std::uint32_t kEmpty = UINT32_MAX;
constexpr float kCell = 0.05F;     // metres of floor
constexpr float kCellsSide = 512;  // coarser in rooms of more than 25 m
constexpr int kCrownReach = 3;     // cells in which a crown is the highest: 15 cm
constexpr std::size_t kCrownsMax = 4096;
constexpr float kBin = 0.04F;  // metres of outlines
constexpr std::size_t kMiddleBin = 25;
constexpr float kHeadHeight = 0.24F;  // chin to crown
constexpr float kHeadDepth = 0.25F;   // to either side of its middle, with its noise
constexpr float kShouldersTop = 0.32F, kShouldersBottom = 0.60F;  // below the crown
constexpr float kBodyDepth = 0.40F;      // to either side of the head's middle, along the view
constexpr float kBodyHalfWidth = 0.42F;  // with the arms
// A bin of an outline counts when so much of it is surface.
constexpr float kFillMin = 0.4F;

}  // namespace

UprightShapes::UprightShapes(const Bounds& inside, const UprightOptions& options)
    : inside_(inside),
      options_(options),
      crowns_(kCrownsMax),
      near_(kFusedPointsMax),
      kept_(kFusedPointsMax) {
  const auto length = static_cast<float>(inside.max.x() - inside.min.x());
  const auto width = static_cast<float>(inside.max.y() - inside.min.y());
  cells_per_m_ = 1 / std::max(kCell, std::max(length, width) / kCellsSide);
  columns_ = static_cast<int>(length * cells_per_m_) + 1;
  rows_ = static_cast<int>(width * cells_per_m_) + 1;
  highest_ = BoundedVector<std::uint32_t>(static_cast<std::size_t>(columns_) *
                                          static_cast<std::size_t>(rows_));
  highest_.resize(highest_.capacity());
}

const FusedCloud& UprightShapes::select(const FusedCloud& cloud) {
  kept_.resize(cloud.points.size());
  std::fill(kept_.begin(), kept_.end(), kDropped);
  find_crowns(cloud);
  for (Head head : crowns_) {
    if (!centre(cloud, head) || !is_person()) continue;
    for (const Near& p : near_)
      if (std::abs(p.across) <= kBodyHalfWidth && std::abs(p.behind) <= kBodyDepth &&
          p.below >= -0.02F)
        kept_[p.point] = kKept;
  }
  copy_kept(cloud);
  return selected_;
}

// The highest point of each cell of the floor that is higher than all around it.
void UprightShapes::find_crowns(const FusedCloud& cloud) {
  std::fill(highest_.begin(), highest_.end(), kEmpty);
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    const FusedPoint& p = cloud.points[i];
    const int column = static_cast<int>((p.x - static_cast<float>(inside_.min.x())) * cells_per_m_);
    const int row = static_cast<int>((p.y - static_cast<float>(inside_.min.y())) * cells_per_m_);
    if (column < 0 || row < 0 || column >= columns_ || row >= rows_) continue;
    std::uint32_t& here = highest_[static_cast<std::size_t>(row * columns_ + column)];
    if (here == kEmpty || p.z > cloud.points[here].z) here = static_cast<std::uint32_t>(i);
  }
  crowns_.clear();
  for (int row = 0; row < rows_; ++row)
    for (int column = 0; column < columns_; ++column) {
      const std::uint32_t mine = highest_[static_cast<std::size_t>(row * columns_ + column)];
      if (mine == kEmpty) continue;
      const FusedPoint& p = cloud.points[mine];
      if (p.z < options_.top_min_m || p.z > options_.top_max_m || p.sigma > options_.sigma_max_m)
        continue;
      bool is_highest = true;
      for (int r = std::max(0, row - kCrownReach); r <= std::min(rows_ - 1, row + kCrownReach); ++r)
        for (int c = std::max(0, column - kCrownReach);
             c <= std::min(columns_ - 1, column + kCrownReach); ++c) {
          const std::uint32_t other = highest_[static_cast<std::size_t>(r * columns_ + c)];
          if (other != kEmpty && other != mine && cloud.points[other].z > p.z) is_highest = false;
        }
      if (!is_highest) continue;
      const float horizontal = std::max(1e-6F, std::hypot(p.away_x, p.away_y));
      (void)crowns_.try_push_back(
          {p.x, p.y, p.z, p.away_x / horizontal, p.away_y / horizontal, p.sensor});
    }
}

void UprightShapes::gather(const FusedCloud& cloud, const Head& head) {
  near_.clear();
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    const FusedPoint& p = cloud.points[i];
    const float x = p.x - head.x, y = p.y - head.y;
    if (p.sensor != head.sensor || std::abs(x) > 1.2F || std::abs(y) > 1.2F) continue;
    (void)near_.try_push_back({head.away_x * y - head.away_y * x, head.top - p.z,
                               head.away_x * x + head.away_y * y, p.area_m2, p.sigma,
                               static_cast<std::uint32_t>(i)});
  }
}

// Moves a crown to the middle of the surface of its head; what is near is then seen from there.
bool UprightShapes::centre(const FusedCloud& cloud, Head& head) {
  for (int round = 0; round < 2; ++round) {
    gather(cloud, head);
    float area = 0, across = 0, behind = 0;
    for (const Near& p : near_) {
      if (p.below < 0 || p.below > kHeadHeight || std::abs(p.across) > 0.14F ||
          std::abs(p.behind) > kHeadDepth)
        continue;
      area += p.area_m2;
      across += p.area_m2 * p.across;
      behind += p.area_m2 * p.behind;
    }
    if (area <= 0) return false;
    across /= area;
    behind /= area;
    head.x += head.away_x * behind - head.away_y * across;
    head.y += head.away_y * behind + head.away_x * across;
  }
  gather(cloud, head);
  return true;
}

UprightShapes::Outline UprightShapes::outline(float below_min, float below_max, float depth) const {
  Outline surface{};
  for (const Near& p : near_) {
    if (p.below < below_min || p.below > below_max || std::abs(p.behind) > depth) continue;
    const float bin = p.across / kBin + static_cast<float>(kMiddleBin) + 0.5F;
    if (bin >= 0 && bin < static_cast<float>(kBins))
      surface[static_cast<std::size_t>(bin)] += p.area_m2;
  }
  for (float& share : surface) share /= kBin * (below_max - below_min);
  return surface;
}

bool UprightShapes::is_person() const {
  // How far the surface goes on from the head's middle.
  const auto reach = [](const Outline& outline, int step) {
    int bins = 0;
    for (int at = static_cast<int>(kMiddleBin); at >= 0 && at < static_cast<int>(kBins);
         at += step) {
      if (outline[static_cast<std::size_t>(at)] < kFillMin) break;
      ++bins;
    }
    return kBin * static_cast<float>(bins);
  };
  const Outline head = outline(0.03F, kHeadHeight - 0.06F, kHeadDepth);
  const Outline body = outline(kShouldersTop, kShouldersBottom, kBodyDepth);
  const float head_width = reach(head, -1) + reach(head, 1) - kBin;
  const float left = reach(body, -1), right = reach(body, 1);
  const float body_width = left + right - kBin;
  return head_width >= options_.head_width_min_m && head_width <= options_.head_width_max_m &&
         body_width >= options_.shoulders_min_m && std::min(left, right) >= 2 * kBin &&
         body_width >= head_width + options_.shoulders_wider_m &&
         clutter(0.20F, 0.32F, 0.03F, 0.18F) <= options_.beside_max &&
         clutter(0, 0.15F, -0.28F, -0.05F) <= options_.above_max &&
         depth_spread() <= options_.depth_spread_max_m;
}

// Share of an outline to the left or right of the head, whichever is fuller, that is surface at its
// distance.
float UprightShapes::clutter(float across_min, float across_max, float below_min,
                             float below_max) const {
  float left = 0, right = 0;
  for (const Near& p : near_) {
    const float aside = std::abs(p.across);
    if (p.below < below_min || p.below > below_max || aside < across_min || aside > across_max ||
        std::abs(p.behind) > kBodyDepth)
      continue;
    (p.across < 0 ? right : left) += p.area_m2;
  }
  return std::max(left, right) / ((across_max - across_min) * (below_max - below_min));
}

// Of head and chest along the view, without the sensor's noise; metres.
float UprightShapes::depth_spread() const {
  double area = 0, sum = 0, squares = 0, noise = 0;
  for (const Near& p : near_) {
    if (std::abs(p.across) > 0.2F || p.below < 0 || p.below > kShouldersBottom ||
        std::abs(p.behind) > 1.5F * kBodyDepth)
      continue;
    area += p.area_m2;
    sum += static_cast<double>(p.area_m2 * p.behind);
    squares += static_cast<double>(p.area_m2 * p.behind * p.behind);
    noise += static_cast<double>(p.area_m2 * p.sigma * p.sigma);
  }
  const double mean = sum / area;
  return static_cast<float>(std::sqrt(std::max(0.0, (squares - noise) / area - mean * mean)));
}

void UprightShapes::copy_kept(const FusedCloud& cloud) {
  selected_.points.clear();
  selected_.contributions.clear();
  selected_.dropped = cloud.dropped;
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    if (kept_[i] != kKept) continue;
    kept_[i] = static_cast<std::uint32_t>(selected_.points.size());
    (void)selected_.points.try_push_back(cloud.points[i]);
  }
  for (Contribution contribution : cloud.contributions) {
    if (kept_[contribution.point] == kDropped) continue;
    contribution.point = kept_[contribution.point];
    (void)selected_.contributions.try_push_back(contribution);
  }
}

}  // namespace wagonsight
