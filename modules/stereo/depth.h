#pragma once

#include <cstdint>
#include <vector>

#include "frame/image.h"
#include "rig/rig.h"
#include "stereo/gray_image.h"

// From disparities to what every other depth sensor gives: millimetres and a noise model.
namespace wagonsight {

// Standard deviation of a disparity in pixels, as measured on pairs with truth (README.md); the
// default is the fast mode's on the Middlebury cone pair with noise on both images.
inline constexpr double kDisparitySigmaPx = 0.25;

// z = f b / d. The table is made once; converting does not allocate.
class DepthTable {
 public:
  // Focal length in pixels of the rectified images and baseline in metres, both > 0. Depths beyond
  // `far_m` (at most 65.535 m) have no reading: their noise is larger than a wagon.
  DepthTable(double focal_px, double baseline_m, double far_m = 20.0);

  // `disparity` in 64ths of a pixel as the matcher writes it; `depth` gets millimetres along the
  // optical axis, rounded, 0 where there is no disparity or the depth is beyond the far end.
  void convert(ImageView<const std::int16_t> disparity, ImageView<std::uint16_t> depth) const {
    convert(disparity, depth, {0, 0, depth.width, depth.height});
  }
  // The same for a part of the image.
  void convert(ImageView<const std::int16_t> disparity, ImageView<std::uint16_t> depth,
               const PixelRect& region) const;

  std::uint16_t millimetres(std::int16_t disparity) const {
    return disparity < 0 ? std::uint16_t{0} : table_[static_cast<std::size_t>(disparity)];
  }

 private:
  std::vector<std::uint16_t> table_;  // by disparity in 64ths
};

// The pair's noise model for the foreground's change test: sigma(z) = z^2 sigma_d / (f b) (Gallup
// et al. 2008), and the step of a disparity's 64th of a pixel.
DepthNoise stereo_noise(double focal_px, double baseline_m,
                        double disparity_sigma_px = kDisparitySigmaPx);

}  // namespace wagonsight
