#include "calibrate/ball_outline.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace wagonsight {
namespace {

constexpr int kRays = 96;
constexpr double kRadiusMin = 2.5, kStep = 0.5;
constexpr double kGradientMin = 6.0;  // grey levels a pixel
constexpr double kSeenMin = 0.55;

struct Edge {
  Eigen::Vector2d at;
  double strength;
  int ray;
};

struct Circle {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double radius = 0;
};

double sample(const cv::Mat& image, double x, double y) {
  const int u = std::clamp(static_cast<int>(std::floor(x)), 0, image.cols - 2);
  const int v = std::clamp(static_cast<int>(std::floor(y)), 0, image.rows - 2);
  const double a = std::clamp(x - u, 0.0, 1.0), b = std::clamp(y - v, 0.0, 1.0);
  const float* top = image.ptr<float>(v) + u;
  const float* below = image.ptr<float>(v + 1) + u;
  return (1 - b) * ((1 - a) * top[0] + a * top[1]) + b * ((1 - a) * below[0] + a * below[1]);
}

// The maxima of the brightness' change along rays from `from`, to sub-pixel by a parabola.
std::vector<Edge> edges_around(const cv::Mat& image, const Eigen::Vector2d& from, double reach) {
  std::vector<Edge> edges;
  const int count = static_cast<int>(reach / kStep);
  std::vector<double> change(static_cast<std::size_t>(count) + 1);
  for (int ray = 0; ray < kRays; ++ray) {
    const double angle = 2 * std::numbers::pi * ray / kRays;
    const Eigen::Vector2d along(std::cos(angle), std::sin(angle));
    const auto inside = [&](const Eigen::Vector2d& p) {
      return p.x() >= 1 && p.y() >= 1 && p.x() <= image.cols - 2 && p.y() <= image.rows - 2;
    };
    for (int i = 0; i <= count; ++i) {
      const Eigen::Vector2d in = from + along * (i * kStep - 0.5), out = in + along;
      change[static_cast<std::size_t>(i)] =
          inside(in) && inside(out)
              ? std::abs(sample(image, out.x(), out.y()) - sample(image, in.x(), in.y()))
              : 0.0;
    }
    for (std::size_t i = 1; i < static_cast<std::size_t>(count); ++i) {
      const double before = change[i - 1], here = change[i], after = change[i + 1];
      if (here < kGradientMin || here < before || here <= after) continue;
      const double bend = before - 2 * here + after;
      const double offset = bend < 0 ? 0.5 * (before - after) / bend : 0.0;
      edges.push_back({from + along * ((static_cast<double>(i) + offset) * kStep), here, ray});
    }
  }
  return edges;
}

std::optional<Circle> circle_through(const Eigen::Vector2d& a, const Eigen::Vector2d& b,
                                     const Eigen::Vector2d& c) {
  const Eigen::Vector2d u = b - a, v = c - a;
  const double twice_area = 2 * (u.x() * v.y() - u.y() * v.x());
  if (std::abs(twice_area) < 1e-6) return std::nullopt;
  const double uu = u.squaredNorm(), vv = v.squaredNorm();
  const Eigen::Vector2d offset((v.y() * uu - u.y() * vv) / twice_area,
                               (u.x() * vv - v.x() * uu) / twice_area);
  return Circle{a + offset, offset.norm()};
}

// An ellipse is within this of its circle: a ball 35 degrees off the axis is 20% longer than wide.
double tolerance(double radius) {
  return 0.8 + 0.06 * radius;
}

// Strength of the outline that agrees with a circle, the best edge of each ray once.
double support(const Circle& circle, const std::vector<Edge>& edges) {
  std::array<double, kRays> of_ray{};
  for (const Edge& edge : edges) {
    const double off = std::abs((edge.at - circle.centre).norm() - circle.radius);
    if (off > tolerance(circle.radius)) continue;
    double& best = of_ray[static_cast<std::size_t>(edge.ray)];
    // Beyond 60 levels an edge is an edge; without this a bright lamp behind would win.
    best =
        std::max(best, std::min(edge.strength, 60.0) * (1 - off / (2 * tolerance(circle.radius))));
  }
  double sum = 0;
  for (const double value : of_ray) sum += value;
  return sum;
}

// The best of circles through three edges of one size; drawn by a fixed sequence.
Circle agree(const std::vector<Edge>& edges, const Eigen::Vector2d& near, double reach) {
  std::uint64_t state = 88172645463325252ULL;
  const auto draw = [&] {
    state ^= state << 13, state ^= state >> 7, state ^= state << 17;
    return static_cast<std::size_t>(state % edges.size());
  };
  Circle best;
  double best_support = 0;
  for (int trial = 0; trial < 1500; ++trial) {
    const Edge &a = edges[draw()], &b = edges[draw()], &c = edges[draw()];
    if (a.ray == b.ray || b.ray == c.ray || a.ray == c.ray) continue;
    const auto circle = circle_through(a.at, b.at, c.at);
    if (!circle || circle->radius < kRadiusMin || circle->radius > reach ||
        (circle->centre - near).norm() > circle->radius)
      continue;
    const double value = support(*circle, edges);
    if (value > best_support) best_support = value, best = *circle;
  }
  return best;
}

double ellipse_distance(const cv::RotatedRect& box, const Eigen::Vector2d& p) {
  const double angle = box.angle * std::numbers::pi / 180;
  const Eigen::Vector2d d = p - Eigen::Vector2d(box.center.x, box.center.y);
  const double x = std::cos(angle) * d.x() + std::sin(angle) * d.y();
  const double y = -std::sin(angle) * d.x() + std::cos(angle) * d.y();
  const double a = box.size.width / 2, b = box.size.height / 2;
  const double scale = std::hypot(x / a, y / b);  // along the ray from the centre
  return scale > 0 ? d.norm() * (1 - 1 / scale) : -std::min(a, b);
}

}  // namespace

std::optional<BallOutline> fit_ball_outline(const GrayImage& image, const Eigen::Vector2d& near,
                                            double radius_max_px) {
  if (!near.allFinite() || near.x() < 2 || near.y() < 2 || near.x() > image.width - 3 ||
      near.y() > image.height - 3)
    return std::nullopt;
  const cv::Mat whole(image.height, image.width, CV_8U, const_cast<std::uint8_t*>(image.pixels));
  cv::Mat smooth;
  whole.convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, {}, 0.8);
  // The click is somewhere on the ball; from its middle all rays meet the outline head on.
  Eigen::Vector2d from = near;
  Circle circle;
  std::vector<Edge> edges;
  double reach = 2 * radius_max_px;
  for (int round = 0; round < 3; ++round) {
    edges = edges_around(smooth, from, reach);
    if (edges.size() < 12) return std::nullopt;
    circle = agree(edges, near, radius_max_px);
    if (circle.radius < kRadiusMin) return std::nullopt;
    from = circle.centre;
    reach = 1.4 * circle.radius + 3;
  }
  std::array<const Edge*, kRays> of_ray{};
  for (const Edge& edge : edges) {
    const double off = std::abs((edge.at - circle.centre).norm() - circle.radius);
    if (off > tolerance(circle.radius)) continue;
    const Edge*& best = of_ray[static_cast<std::size_t>(edge.ray)];
    if (best == nullptr || edge.strength > best->strength) best = &edge;
  }
  std::vector<cv::Point2f> outline;
  for (const Edge* edge : of_ray)
    if (edge != nullptr)
      outline.emplace_back(static_cast<float>(edge->at.x()), static_cast<float>(edge->at.y()));
  cv::RotatedRect box;
  for (int round = 0; round < 3; ++round) {
    if (static_cast<double>(outline.size()) < kSeenMin * kRays) return std::nullopt;
    box = cv::fitEllipseDirect(outline);
    if (round == 2) break;
    double sum = 0;
    for (const auto& p : outline) sum += std::pow(ellipse_distance(box, {p.x, p.y}), 2);
    const double limit = std::max(0.3, 2.5 * std::sqrt(sum / static_cast<double>(outline.size())));
    std::erase_if(outline, [&](const cv::Point2f& p) {
      return std::abs(ellipse_distance(box, {p.x, p.y})) > limit;
    });
  }
  BallOutline found;
  found.centre = {box.center.x, box.center.y};
  double angle = box.angle * std::numbers::pi / 180;
  found.semi_axes_px = {box.size.width / 2, box.size.height / 2};
  if (found.semi_axes_px[0] < found.semi_axes_px[1]) {
    std::swap(found.semi_axes_px[0], found.semi_axes_px[1]);
    angle += std::numbers::pi / 2;
  }
  if (!(found.semi_axes_px[1] > 0.6 * found.semi_axes_px[0]) ||
      found.semi_axes_px[0] > 1.3 * radius_max_px)
    return std::nullopt;
  found.angle = std::remainder(angle, std::numbers::pi);
  double sum = 0;
  for (const auto& p : outline) sum += std::pow(ellipse_distance(box, {p.x, p.y}), 2);
  found.rms_px = std::sqrt(sum / static_cast<double>(outline.size()));
  found.seen_share = static_cast<double>(outline.size()) / kRays;
  return found;
}

}  // namespace wagonsight
