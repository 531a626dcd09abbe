#pragma once

#include <cstdint>
#include <span>

#include "stereo/gray_image.h"
#include "stereo/rectify.h"

// Shutter and gain from what the last image looked like: a pure function of the image's statistics
// and the settings it was taken with. The driver applies what comes out.
namespace wagonsight {

struct ExposureStatistics {
  double mean = 0;           // of the pixels inside, as a share of full scale, 0 .. 1
  double dark_share = 0;     // of pixels below 2% of full scale
  double bright_share = 0;   // of pixels at or above 97%
  std::uint32_t pixels = 0;  // that were looked at
};

// Looks at every fourth pixel in both directions that is inside. `mask` has a bit a pixel, row by
// row (1 inside: no window, no screen); empty means all. `full_scale` is the largest gray value
// (255, 4095). With a table, `image` is the camera's own and `mask` of the rectified one. Does not
// allocate.
ExposureStatistics measure_exposure(const GrayImage& image, std::span<const std::uint64_t> mask,
                                    int full_scale, RectifyTable table = {});

struct ExposureSettings {
  double shutter_us = 2000;
  double gain_db = 0;
};

struct ExposureLimits {
  double shutter_us_min = 20;
  double shutter_us_max = 8000;  // a passenger walking at 1.5 m/s moves 12 mm meanwhile
  double gain_db_min = 0;
  double gain_db_max = 18;
};

struct ExposureTarget {
  double mean = 0.35;              // of full scale
  double bright_share_max = 0.02;  // more than this counts as overexposed
  double tolerance = 0.08;         // relative; within it nothing changes
};

struct ExposureDecision {
  ExposureSettings next;
  bool usable = true;  // false: too dark or too bright for matching, nothing learned from it
};

// The settings for the next image. The exposure (shutter times gain) is changed by the ratio of
// wanted to measured brightness; an image that is mostly saturated or mostly dark tells no ratio
// and is answered by a fixed large step, so that a tunnel's end is mastered within a few images.
// The shutter is used first, the gain only when the shutter has reached its end.
ExposureDecision next_exposure(const ExposureStatistics& seen, const ExposureSettings& used,
                               const ExposureLimits& limits = {},
                               const ExposureTarget& target = {});

}  // namespace wagonsight
