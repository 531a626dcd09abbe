#include "calibrate/saddle_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "calibrate/saddle_strength.h"

namespace wagonsight {
namespace {

constexpr int kRing = 32;  // samples about a candidate
constexpr double kContrastMin = 12;
constexpr std::size_t kPointsMax = 3000;

float sample(const cv::Mat& pixels, double x, double y) {
  const int u = static_cast<int>(x), v = static_cast<int>(y);
  const auto a = static_cast<float>(x - u), b = static_cast<float>(y - v);
  const float* here = pixels.ptr<float>(v) + u;
  const float* below = pixels.ptr<float>(v + 1) + u;
  return (1 - b) * ((1 - a) * here[0] + a * here[1]) + b * ((1 - a) * below[0] + a * below[1]);
}

// Judges a candidate by the ring of radius `radius` about it.
std::optional<SaddlePoint> judge(const cv::Mat& pixels, double x, double y, double radius) {
  if (x < radius + 1 || y < radius + 1 || x > pixels.cols - radius - 3 ||
      y > pixels.rows - radius - 3)
    return std::nullopt;
  std::array<double, kRing> ring{};
  double mean = 0, cosine = 0, sine = 0;
  for (int i = 0; i < kRing; ++i) {
    const double angle = 2 * std::numbers::pi * i / kRing;
    ring[static_cast<std::size_t>(i)] = static_cast<double>(
        sample(pixels, x + radius * std::cos(angle), y + radius * std::sin(angle)));
    mean += ring[static_cast<std::size_t>(i)] / kRing;
  }
  double energy = 0, odd = 0;
  for (int i = 0; i < kRing; ++i) {
    const double angle = 2 * std::numbers::pi * i / kRing;
    double& value = ring[static_cast<std::size_t>(i)];
    value -= mean;
    energy += value * value;
    cosine += value * std::cos(2 * angle) * 2 / kRing;
    sine += value * std::sin(2 * angle) * 2 / kRing;
  }
  for (int i = 0; i < kRing / 2; ++i) {
    const double d =
        ring[static_cast<std::size_t>(i)] - ring[static_cast<std::size_t>(i) + kRing / 2];
    odd += d * d / 2;
  }
  const double amplitude = std::hypot(cosine, sine);
  // A chessboard's ring is point symmetric and goes twice up and down.
  if (2 * amplitude < kContrastMin || odd > 0.3 * energy ||
      amplitude * amplitude * kRing / 2 < 0.55 * energy)
    return std::nullopt;
  SaddlePoint point;
  point.pixel = {x, y};
  point.contrast = 2 * amplitude;
  point.bright_angle = std::atan2(sine, cosine) / 2;
  // Where the ring crosses its mean the edges lie: four places, opposite ones of one edge.
  std::array<double, 4> crossings{};
  std::size_t count = 0;
  for (int i = 0; i < kRing; ++i) {
    const double a = ring[static_cast<std::size_t>(i)],
                 b = ring[static_cast<std::size_t>((i + 1) % kRing)];
    if ((a < 0) == (b < 0)) continue;
    if (count == 4) return std::nullopt;
    crossings[count++] = 2 * std::numbers::pi * (i + a / (a - b)) / kRing;
  }
  if (count != 4) return std::nullopt;
  for (std::size_t e = 0; e < 2; ++e) {
    const Eigen::Vector2d one(std::cos(crossings[e]), std::sin(crossings[e]));
    const Eigen::Vector2d opposite(std::cos(crossings[e + 2]), std::sin(crossings[e + 2]));
    if ((one - opposite).norm() < 1.2) return std::nullopt;  // bent: no straight edge
    point.edges[e] = (one - opposite).normalized();
  }
  return point;
}

void find_at_scale(const cv::Mat& gray, double sigma, std::vector<SaddlePoint>& points) {
  cv::Mat pixels;
  gray.convertTo(pixels, CV_32F);
  cv::GaussianBlur(pixels, pixels, {}, sigma, sigma, cv::BORDER_REPLICATE);
  const cv::Mat strength = saddle_strength(pixels);
  cv::Mat highest;
  const int reach = 2 * static_cast<int>(std::lround(1 + sigma)) + 1;
  cv::dilate(strength, highest, cv::Mat::ones(reach, reach, CV_8U));
  const double least = kContrastMin / (std::numbers::pi * sigma * sigma) / 2;
  for (int v = 1; v + 1 < strength.rows; ++v)
    for (int u = 1; u + 1 < strength.cols; ++u) {
      const float here = strength.at<float>(v, u);
      if (static_cast<double>(here) < least || here < highest.at<float>(v, u)) continue;
      const auto point = judge(pixels, u, v, 2 + 2 * sigma);
      if (!point) continue;
      // Finer scales came first and place a corner better.
      const double apart = 2 + 2 * sigma;
      if (std::none_of(points.begin(), points.end(), [&](const SaddlePoint& p) {
            return (p.pixel - point->pixel).squaredNorm() < apart * apart;
          }))
        points.push_back(*point);
    }
}

}  // namespace

std::vector<SaddlePoint> find_saddle_points(const GrayImage& image) {
  const cv::Mat gray(image.height, image.width, CV_8U, const_cast<std::uint8_t*>(image.pixels));
  std::vector<SaddlePoint> points;
  for (const double sigma : {1.0, 2.0, 4.0}) find_at_scale(gray, sigma, points);
  std::stable_sort(points.begin(), points.end(), [](const SaddlePoint& a, const SaddlePoint& b) {
    return a.contrast > b.contrast;
  });
  if (points.size() > kPointsMax) points.resize(kPointsMax);
  return points;
}

}  // namespace wagonsight
