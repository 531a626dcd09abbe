#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "frame/image.h"

namespace wagonsight {

using GrayImage = ImageView<const std::uint8_t>;

struct SnappedCorner {
  Eigen::Vector2d pixel;  // 0-based, sub-pixel
  // How much of a saddle the place is: 1 for a sharp corner of full contrast, 0 for a plain wall.
  double strength = 0;
};

// The chessboard corner nearest to `near`: the strongest saddle of the brightness within
// `radius_px`, then refined until every gradient about it points across the line to it (Foerstner
// 1987; OpenCV's cornerSubPix). `half_window_px` should stay below half of a square. Nothing where
// the image has no saddle there: a hidden corner must not be invented. Deterministic, allocates.
std::optional<SnappedCorner> snap_to_saddle(const GrayImage& image, const Eigen::Vector2d& near,
                                            double radius_px, int half_window_px = 5);

}  // namespace wagonsight
