#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/result.h"
#include "geometry/camera.h"
#include "geometry/transform.h"
#include "stereo/gray_image.h"

// Rectification: both images of a pair resampled onto one plane, so that a point lies on the same
// row in both.
namespace wagonsight {

// Where one rectified pixel is taken from, in 32 bits: the index of the upper left one of four
// source pixels (21 bits, all of kImagePixelsMax), and the position between them in 32nds of a
// pixel (5 bits across, 5 down). A table is half as large as a map of two 16-bit coordinates with
// its weights, which is what resampling waits for.
using RectifyEntry = std::uint32_t;
inline constexpr RectifyEntry kOutsideSource = 1U << 31;  // the source does not see this pixel
using RectifyTable = std::span<const RectifyEntry>;

// What a pair becomes. S, the sensor's frame, is the rectified left imager.
struct StereoRectification {
  Camera camera;    // of both rectified images; without distortion
  double baseline;  // metres, > 0
  Rigid X_LS;       // rectified to left camera: a rotation
  Rigid X_RS;       // rectified to right camera: its rotation, and the right camera's place
  std::vector<RectifyEntry> left, right;  // an entry a pixel, row by row
};

struct RectifyOptions {
  double zoom = 1.0;  // of the focal length; below 1 keeps more of the corners
};

// The tables of a pair. `X_LR` maps from the right camera's frame to the left one's; both cameras
// have images of one size. The rectified plane stands on the baseline and faces the mean of the two
// optical axes (Bouguet's choice: either image turns as little as possible). An Error when the
// sizes differ or exceed kImagePixelsMax, or the right camera is not to the right of the left.
// Allocates.
Result<StereoRectification> make_rectification(const Camera& left, const Camera& right,
                                               const Rigid& X_LR,
                                               const RectifyOptions& options = {});

// out(i) = the source interpolated bilinearly at table[i], rounded to nearest; 0 where
// kOutsideSource. The source has the format's pixels (kGray8 or kGray16 below 2^15), `out` the same
// format and as many pixels as the table. Does not allocate; the same bytes on every processor.
void rectify(const GrayImage& source, RectifyTable table, void* out);
// The same for a part of the rectified image, which is of the source's size; `table` and `out` are
// the whole image's. Some pixels beside the part may be written, too.
void rectify_part(const GrayImage& source, RectifyTable table, const PixelRect& part, void* out);

}  // namespace wagonsight
