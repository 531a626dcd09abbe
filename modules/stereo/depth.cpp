#include "stereo/depth.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "stereo/matcher_kernels.h"

namespace wagonsight {

using stereo_kernels::kDisparityScale;

DepthTable::DepthTable(double focal_px, double baseline_m, double far_m)
    : table_(std::size_t{1} << 15) {
  WS_CHECK(focal_px > 0 && baseline_m > 0 && far_m > 0 && far_m <= 65.535,
           "focal %g px, baseline %g m, far %g m", focal_px, baseline_m, far_m);
  for (std::size_t disparity = 1; disparity < table_.size(); ++disparity) {
    const double metres = focal_px * baseline_m * kDisparityScale / static_cast<double>(disparity);
    if (metres <= far_m)
      table_[disparity] = static_cast<std::uint16_t>(std::lround(metres * 1000.0));
  }
}

void DepthTable::convert(ImageView<const std::int16_t> disparity, ImageView<std::uint16_t> depth,
                         const PixelRect& region) const {
  WS_CHECK(disparity.width == depth.width && disparity.height == depth.height,
           "%d x %d into %d x %d", disparity.width, disparity.height, depth.width, depth.height);
  WS_CHECK(
      region.x0 >= 0 && region.y0 >= 0 && region.x1 <= depth.width && region.y1 <= depth.height,
      "rows %d to %d, columns %d to %d", region.y0, region.y1, region.x0, region.x1);
  const std::uint16_t* table = table_.data();
  for (int y = region.y0; y < region.y1; ++y) {
    const std::int16_t* in = disparity.pixels + disparity.index(0, y);
    std::uint16_t* out = depth.pixels + depth.index(0, y);
    // Entry 0, an infinite depth, is 0: it serves the pixels without a disparity too.
    for (int x = region.x0; x < region.x1; ++x) out[x] = table[std::max<int>(in[x], 0)];
  }
}

DepthNoise stereo_noise(double focal_px, double baseline_m, double disparity_sigma_px) {
  DepthNoise noise;
  noise.a = 0.001;  // half a millimetre of rounding, and what a calibration leaves
  noise.b = 0;
  noise.c = disparity_sigma_px / (focal_px * baseline_m);
  noise.quantisation_per_z2 = 1.0 / (focal_px * baseline_m * kDisparityScale);
  return noise;
}

}  // namespace wagonsight
