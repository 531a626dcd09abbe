#include "capture/clock_fit.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

constexpr double kEarlyImpossible_s = 0.1;
constexpr double kLateImpossible_s = 0.5;

}  // namespace

HostTime ClockFit::observe(std::uint64_t ticks, HostTime arrival) {
  if (!started_ || ticks < last_ticks_) restart(ticks, arrival);
  last_ticks_ = ticks;
  Point point{device_seconds(ticks), 0};
  point.residual = to_seconds(arrival - origin_) - point.x;
  if (point.residual < line(point.x) - kEarlyImpossible_s) {
    restart(ticks, arrival);
    point = {};
  }
  if (point.x >= bin_begin_ + kBin_s) {
    if (bin_least_ && bin_lateness_least_ > kLateImpossible_s) {
      restart(ticks, arrival);
      point = {};
    } else {
      close_bin();
      bin_begin_ = point.x;
    }
  }
  const double lateness = point.residual - line(point.x);
  if (!bin_least_ || lateness < bin_lateness_least_) {
    bin_least_ = point;
    bin_lateness_least_ = lateness;
  }
  if (lateness < 0) {
    anchor_ = point;
    bin_lateness_least_ = 0;
  }
  last_lateness_ = from_seconds(std::max(lateness, 0.0));
  return to_host(ticks);
}

HostTime ClockFit::to_host(std::uint64_t ticks) const {
  const double x = device_seconds(ticks);
  return origin_ + from_seconds(x + line(x)) - options_.latency_min;
}

double ClockFit::device_seconds(std::uint64_t ticks) const {
  const auto since = static_cast<std::int64_t>(ticks - origin_ticks_);
  return static_cast<double>(since) / options_.ticks_per_s;
}

void ClockFit::restart(std::uint64_t ticks, HostTime arrival) {
  if (started_) ++restarts_;
  started_ = true;
  origin_ticks_ = last_ticks_ = ticks;
  origin_ = arrival;
  points_.clear();
  bin_least_.reset();
  bin_begin_ = 0;
  bin_lateness_least_ = 0;
  anchor_ = {};
  drift_ = 0;
}

void ClockFit::close_bin() {
  if (!bin_least_) return;
  if (points_.full()) {
    std::copy(points_.begin() + 1, points_.end(), points_.begin());
    points_.pop_back();
  }
  points_.push_back(*bin_least_);
  bin_least_.reset();
  fit();
}

void ClockFit::fit() {
  // Lower convex hull, left to right (Andrew's monotone chain).
  FixedVector<Point, kPointsMax> hull;
  double x_sum = 0;
  for (const Point& p : points_) {
    x_sum += p.x;
    while (hull.size() >= 2) {
      const Point& a = hull[hull.size() - 2];
      const Point& b = hull.back();
      const double cross =
          (b.x - a.x) * (p.residual - a.residual) - (b.residual - a.residual) * (p.x - a.x);
      if (cross > 0) break;
      hull.pop_back();
    }
    hull.push_back(p);
  }
  const double span = points_.back().x - points_[0].x;
  if (span < options_.baseline_s) {
    const auto least =
        std::min_element(points_.begin(), points_.end(),
                         [](const Point& a, const Point& b) { return a.residual < b.residual; });
    anchor_ = *least;
    drift_ = 0;
    return;
  }
  const double x_mean = x_sum / static_cast<double>(points_.size());
  std::size_t right = 1;
  while (right + 1 < hull.size() && hull[right].x < x_mean) ++right;
  const Point &a = hull[right - 1], &b = hull[right];
  const double limit = options_.drift_ppm_max * 1e-6;
  drift_ = std::clamp((b.residual - a.residual) / (b.x - a.x), -limit, limit);
  anchor_ = a;
  // A clamped slope would cut through other points; the line goes below all of them.
  for (const Point& p : points_)
    if (p.residual < line(p.x)) anchor_ = p;
}

}  // namespace wagonsight
