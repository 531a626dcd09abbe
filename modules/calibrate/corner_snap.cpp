#include "calibrate/corner_snap.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "calibrate/saddle_strength.h"

namespace wagonsight {
namespace {

// A saddle weaker than this share of full contrast is texture or noise.
constexpr double kStrengthMin = 0.06;

// The part of the image that is looked at, as floats, smoothed against noise.
struct Patch {
  cv::Mat pixels;
  cv::Point origin;
};

Patch cut(const GrayImage& image, const Eigen::Vector2d& centre, double half) {
  const cv::Mat whole(image.height, image.width, CV_8U, const_cast<std::uint8_t*>(image.pixels));
  const int reach = static_cast<int>(std::ceil(half)) + 4;
  const cv::Point middle(static_cast<int>(std::lround(centre.x())),
                         static_cast<int>(std::lround(centre.y())));
  const cv::Rect wanted(middle.x - reach, middle.y - reach, 2 * reach + 1, 2 * reach + 1);
  const cv::Rect inside = wanted & cv::Rect(0, 0, image.width, image.height);
  Patch patch;
  patch.origin = inside.tl();
  if (inside.width < 7 || inside.height < 7) return patch;
  whole(inside).convertTo(patch.pixels, CV_32F);
  cv::GaussianBlur(patch.pixels, patch.pixels, {}, 1.2, 1.2, cv::BORDER_REPLICATE);
  return patch;
}

// How a full-contrast corner answers, so that strengths are shares of it: 255 / (pi * 1.8), with
// the blur above and the lens' own together about 1.35 px.
constexpr double kFullStrength = 255 / (3.14159265 * 1.8);

}  // namespace

std::optional<SnappedCorner> snap_to_saddle(const GrayImage& image, const Eigen::Vector2d& near,
                                            double radius_px, int half_window_px) {
  if (!near.allFinite() || near.x() < 0 || near.y() < 0 || near.x() > image.width - 1 ||
      near.y() > image.height - 1)
    return std::nullopt;
  const Patch patch = cut(image, near, radius_px);
  if (patch.pixels.empty()) return std::nullopt;
  const cv::Mat strength = saddle_strength(patch.pixels);
  double best = 0;
  cv::Point at;
  for (int v = 0; v < strength.rows; ++v)
    for (int u = 0; u < strength.cols; ++u) {
      const double distance =
          std::hypot(u + patch.origin.x - near.x(), v + patch.origin.y - near.y());
      if (distance > radius_px) continue;
      // The nearer of two corners was meant, unless it is all but none.
      const double worth = strength.at<float>(v, u) * (1 - distance / (radius_px + 1));
      if (worth > best) best = worth, at = {u, v};
    }
  const double share = best > 0 ? strength.at<float>(at) / kFullStrength : 0;
  if (share < kStrengthMin) return std::nullopt;
  const cv::Point2f found(static_cast<float>(at.x + patch.origin.x),
                          static_cast<float>(at.y + patch.origin.y));
  const int half = std::clamp(half_window_px, 2, 15);
  const int border = half + 2;
  if (found.x < static_cast<float>(border) || found.y < static_cast<float>(border) ||
      found.x >= static_cast<float>(image.width - border) ||
      found.y >= static_cast<float>(image.height - border))
    return std::nullopt;  // the window would hang over the edge and pull the corner inwards
  const cv::Mat whole(image.height, image.width, CV_8U, const_cast<std::uint8_t*>(image.pixels));
  std::vector<cv::Point2f> corner{found};
  cv::cornerSubPix(whole, corner, {half, half}, {-1, -1},
                   {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 60, 1e-3});
  // Foreign edges in the window (a hand, the board's rim) drag the refinement away from the saddle.
  if (std::hypot(corner[0].x - found.x, corner[0].y - found.y) > 1.8) return std::nullopt;
  return SnappedCorner{{corner[0].x, corner[0].y}, std::min(1.0, share)};
}

}  // namespace wagonsight
