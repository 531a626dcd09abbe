#include "stereo/rectify.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "rig/stereo_pair.h"
#include "stereo/rectify_kernels.h"

namespace wagonsight {
namespace {

constexpr int kSteps = 32;  // of a pixel, between two source pixels

// The squared radius up to which the radial distortion grows with the radius; beyond, a second,
// false image of the edge would be folded in.
double radius2_where_distortion_folds(const Camera& camera) {
  constexpr double kFarthest = 16;  // 76 degrees off the axis
  const double k1 = camera.distortion[0], k2 = camera.distortion[1], k3 = camera.distortion[4];
  for (double r2 = 0; r2 < kFarthest; r2 += 0.002)
    if (1 + r2 * (3 * k1 + r2 * (5 * k2 + r2 * 7 * k3)) <= 0) return r2;
  return kFarthest;
}

// Entry of a source position in pixels.
RectifyEntry entry_at(const Camera& camera, const Eigen::Vector2d& pixel) {
  const double x = std::round(pixel.x() * kSteps), y = std::round(pixel.y() * kSteps);
  // Half a pixel beyond the centres of the border pixels still is of the image.
  constexpr double kHalf = kSteps / 2.0;
  const double right = (camera.width - 1) * kSteps, bottom = (camera.height - 1) * kSteps;
  if (!(x >= -kHalf && x <= right + kHalf && y >= -kHalf && y <= bottom + kHalf))
    return kOutsideSource;
  const int column = std::clamp(static_cast<int>(x), 0, static_cast<int>(right));
  const int row = std::clamp(static_cast<int>(y), 0, static_cast<int>(bottom));
  // The last column and row are reached from the one before with the largest weight there is,
  // 31/32, so that four source pixels always exist.
  int u = column / kSteps, v = row / kSteps, fine_u = column % kSteps, fine_v = row % kSteps;
  if (u == camera.width - 1) --u, fine_u = kSteps - 1;
  if (v == camera.height - 1) --v, fine_v = kSteps - 1;
  return static_cast<RectifyEntry>(v * camera.width + u) << 10 |
         static_cast<RectifyEntry>(fine_v << 5 | fine_u);
}

std::vector<RectifyEntry> make_table(const Camera& rectified, const Camera& source,
                                     const Eigen::Matrix3d& R_source_rectified) {
  const double fold = radius2_where_distortion_folds(source);
  std::vector<RectifyEntry> table;
  table.reserve(static_cast<std::size_t>(rectified.width) *
                static_cast<std::size_t>(rectified.height));
  for (int v = 0; v < rectified.height; ++v)
    for (int u = 0; u < rectified.width; ++u) {
      const Eigen::Vector3d ray =
          R_source_rectified * Eigen::Vector3d((u - rectified.cx) / rectified.fx,
                                               (v - rectified.cy) / rectified.fy, 1.0);
      RectifyEntry entry = kOutsideSource;
      if (ray.z() > 1e-6 && ray.head<2>().squaredNorm() < fold * ray.z() * ray.z())
        if (const auto pixel = project(source, ray)) entry = entry_at(source, *pixel);
      table.push_back(entry);
    }
  return table;
}

}  // namespace

Result<StereoRectification> make_rectification(const Camera& left, const Camera& right,
                                               const Rigid& X_LR, const RectifyOptions& options) {
  const auto pair = rectified_pair(left, right, X_LR, options.zoom);
  if (!pair) return tl::unexpected(pair.error());
  StereoRectification result;
  result.camera = pair->camera;
  result.baseline = pair->baseline;
  result.X_LS = pair->X_LS;
  result.X_RS = pair->X_RS;
  result.left = make_table(pair->camera, left, pair->X_LS.rotation.toRotationMatrix());
  result.right = make_table(pair->camera, right, pair->X_RS.rotation.toRotationMatrix());
  return result;
}

void rectify(const GrayImage& source, RectifyTable table, void* out) {
  const stereo_kernels::ResampleRun run{
      table.data(), table.size(), source.width,
      static_cast<std::size_t>(source.width) * static_cast<std::size_t>(source.height)};
  const auto& kernels = stereo_kernels::best_resample();
  if (source.format == PixelFormat::kGray8) {
    kernels.gray8(run, static_cast<const std::uint8_t*>(source.pixels),
                  static_cast<std::uint8_t*>(out));
    return;
  }
  WS_CHECK(source.format == PixelFormat::kGray16, "pixel format %d",
           static_cast<int>(source.format));
  kernels.gray16(run, static_cast<const std::uint16_t*>(source.pixels),
                 static_cast<std::uint16_t*>(out));
}

void rectify_part(const GrayImage& source, RectifyTable table, const PixelRect& part, void* out) {
  constexpr int kTogether = 16;  // as many as the widest kernel makes at a time
  const int x0 = part.x0 / kTogether * kTogether;
  const int x1 = std::min((part.x1 + kTogether - 1) / kTogether * kTogether, source.width);
  const std::size_t row = static_cast<std::size_t>(source.width);
  for (int y = part.y0; y < part.y1 && x0 < x1; ++y) {
    const std::size_t first = static_cast<std::size_t>(y) * row + static_cast<std::size_t>(x0);
    rectify(source, table.subspan(first, static_cast<std::size_t>(x1 - x0)),
            static_cast<std::byte*>(out) + first * bytes_per_pixel(source.format));
  }
}

}  // namespace wagonsight
