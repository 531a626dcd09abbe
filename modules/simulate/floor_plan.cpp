#include "simulate/floor_plan.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "simulate/room.h"

namespace wagonsight {
namespace {

using Eigen::Vector2d;

constexpr double kBodyRadius = 0.17;  // a person turns the shoulders where it is narrow
constexpr double kComfort = 0.38;     // metres of air that people keep to furniture

struct Footprint {
  Vector2d centre, half;
  double yaw;
};

std::vector<Footprint> footprints_of(const Scene& scene) {
  std::vector<Footprint> prints;
  for (const SceneBox& box : scene.boxes) {
    if (box.max.z() < 0.1 || box.min.z() > 1.7) continue;  // stepped over, walked under
    prints.push_back({0.5 * (box.min + box.max).head<2>(), 0.5 * (box.max - box.min).head<2>(), 0});
  }
  for (const SceneSeat& seat : scene.seats)
    prints.push_back({seat.position, {0.5 * kSeatDepth, 0.5 * seat.width}, seat.yaw});
  return prints;
}

double distance(const Footprint& print, const Vector2d& p) {
  const Vector2d d = p - print.centre;
  const double c = std::cos(print.yaw), s = std::sin(print.yaw);
  const Vector2d local(std::abs(c * d.x() + s * d.y()) - print.half.x(),
                       std::abs(-s * d.x() + c * d.y()) - print.half.y());
  return local.cwiseMax(0).norm();
}

}  // namespace

FloorPlan::FloorPlan(const Scene& scene)
    : columns_(static_cast<int>(std::ceil(scene.length / kCell))),
      rows_(static_cast<int>(std::ceil(scene.width / kCell))),
      length_(scene.length),
      width_(scene.width),
      clearance_(static_cast<std::size_t>(columns_ * rows_)),
      cost_(clearance_.size()),
      from_(clearance_.size()) {
  trail_.reserve(clearance_.size());
  open_.reserve(clearance_.size() * 8);
  const auto prints = footprints_of(scene);
  for (int cell = 0; cell < columns_ * rows_; ++cell) {
    const Vector2d p = middle_of(cell);
    double least = std::min({kClearanceMax, p.x(), p.y(), length_ - p.x(), width_ - p.y()});
    for (const Footprint& print : prints) least = std::min(least, distance(print, p));
    clearance_[static_cast<std::size_t>(cell)] = static_cast<float>(least);
  }
}

int FloorPlan::cell_of(const Vector2d& p) const {
  const int column = std::clamp(static_cast<int>(p.x() / kCell), 0, columns_ - 1);
  const int row = std::clamp(static_cast<int>(p.y() / kCell), 0, rows_ - 1);
  return row * columns_ + column;
}

Vector2d FloorPlan::middle_of(int cell) const {
  return {(cell % columns_ + 0.5) * kCell, (cell / columns_ + 0.5) * kCell};
}

double FloorPlan::clearance(const Vector2d& p) const {
  return static_cast<double>(clearance_[static_cast<std::size_t>(cell_of(p))]);
}

bool FloorPlan::walkable(const Vector2d& p) const {
  if (p.x() < 0 || p.y() < 0 || p.x() > length_ || p.y() > width_) return false;
  return clearance(p) >= kBodyRadius;
}

bool FloorPlan::straight(const Vector2d& a, const Vector2d& b, double clearance_min) const {
  const double length = (b - a).norm();
  const int steps = std::max(1, static_cast<int>(length / (0.5 * kCell)));
  for (int i = 1; i < steps; ++i)
    if (clearance(a + (b - a) * (static_cast<double>(i) / steps)) < clearance_min) return false;
  return true;
}

int FloorPlan::nearest_walkable(int cell) const {
  const Vector2d at = middle_of(cell);
  int best = cell;
  double best_distance = 1e9;
  for (int other = 0; other < columns_ * rows_; ++other) {
    if (static_cast<double>(clearance_[static_cast<std::size_t>(other)]) < kBodyRadius) continue;
    const double d = (middle_of(other) - at).squaredNorm();
    if (d < best_distance) best_distance = d, best = other;
  }
  return best;
}

void FloorPlan::expand(int cell, int goal) {
  const auto later = [](const Open& a, const Open& b) { return a.estimate > b.estimate; };
  const int column = cell % columns_, row = cell / columns_;
  for (int dv = -1; dv <= 1; ++dv) {
    for (int du = -1; du <= 1; ++du) {
      const int c = column + du, r = row + dv;
      if ((du == 0 && dv == 0) || c < 0 || r < 0 || c >= columns_ || r >= rows_) continue;
      const int next = r * columns_ + c;
      const double clear = static_cast<double>(clearance_[static_cast<std::size_t>(next)]);
      if (clear < kBodyRadius) continue;
      const double strain = 1 + 6 * std::max(0.0, kComfort - clear) / kComfort;
      const double step = kCell * (du != 0 && dv != 0 ? 1.41421356 : 1.0) * strain;
      const auto cost = cost_[static_cast<std::size_t>(cell)] + static_cast<float>(step);
      if (cost >= cost_[static_cast<std::size_t>(next)]) continue;
      if (open_.size() == open_.capacity()) return;
      cost_[static_cast<std::size_t>(next)] = cost;
      from_[static_cast<std::size_t>(next)] = cell;
      const auto rest = static_cast<float>((middle_of(next) - middle_of(goal)).norm());
      open_.push_back({cost + rest, next});
      std::push_heap(open_.begin(), open_.end(), later);
    }
  }
}

bool FloorPlan::search(int start, int goal) {
  const auto later = [](const Open& a, const Open& b) { return a.estimate > b.estimate; };
  std::fill(cost_.begin(), cost_.end(), 1e9F);
  std::fill(from_.begin(), from_.end(), -1);
  open_.clear();
  cost_[static_cast<std::size_t>(start)] = 0;
  open_.push_back({0, start});
  while (!open_.empty()) {
    std::pop_heap(open_.begin(), open_.end(), later);
    const Open node = open_.back();
    open_.pop_back();
    if (node.cell == goal) return true;
    const auto rest = static_cast<float>((middle_of(node.cell) - middle_of(goal)).norm());
    if (node.estimate > cost_[static_cast<std::size_t>(node.cell)] + rest + 1e-4F) continue;
    expand(node.cell, goal);
  }
  return false;
}

void FloorPlan::find_way(const Vector2d& from, const Vector2d& to, Waypoints& way) {
  way.clear();
  const int start = nearest_walkable(cell_of(from)), goal = nearest_walkable(cell_of(to));
  if (!search(start, goal)) {
    way.push_back(to);  // walled off: a passenger of a scene walks through rather than never
    return;
  }
  trail_.clear();
  for (int cell = goal; cell >= 0; cell = from_[static_cast<std::size_t>(cell)])
    trail_.push_back(cell);
  std::reverse(trail_.begin(), trail_.end());
  // Pull the string tight: go on to the farthest corner that is straight ahead.
  Vector2d at = from;
  std::size_t next = 0;
  while (next < trail_.size() && way.size() + 2 < kWaypointsMax) {
    std::size_t farthest = next;
    for (std::size_t i = next; i < trail_.size(); ++i) {
      const Vector2d p = middle_of(trail_[i]);
      const double least = std::min({clearance(at), clearance(p), kComfort});
      if (straight(at, p, std::max(least - 0.05, kBodyRadius))) farthest = i;
    }
    at = middle_of(trail_[farthest]);
    way.push_back(at);
    next = farthest + 1;
  }
  if (walkable(to) || (to - at).norm() < kClearanceMax) {
    if (!way.empty() && (way.back() - to).norm() < 0.15) way.pop_back();
    way.push_back(to);
  }
}

}  // namespace wagonsight
