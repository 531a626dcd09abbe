#include "stereo/rectify.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "base/capacities.h"
#include "base/check.h"
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
  if (!(x >= -kHalf && x <= right + kHalf && y >= -kHalf && y <= bottom + kHalf)) return kOutside;
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
      RectifyEntry entry = kOutside;
      if (ray.z() > 1e-6 && ray.head<2>().squaredNorm() < fold * ray.z() * ray.z())
        if (const auto pixel = project(source, ray)) entry = entry_at(source, *pixel);
      table.push_back(entry);
    }
  return table;
}

// The pixel of the middle of `source`'s image on a plane of focal length f without a centre.
Eigen::Vector2d middle_on_plane(const Camera& source, const Eigen::Matrix3d& R_rectified_source,
                                double focal) {
  const Eigen::Vector2d middle((source.width - 1) / 2.0, (source.height - 1) / 2.0);
  const Eigen::Vector3d ray =
      R_rectified_source * ray_through(source, middle).value_or(Eigen::Vector3d::UnitZ());
  return focal * ray.head<2>() / ray.z();
}

}  // namespace

Result<StereoRectification> make_rectification(const Camera& left, const Camera& right,
                                               const Rigid& X_LR, const RectifyOptions& options) {
  const auto size = [](const Camera& c) {
    return std::to_string(c.width) + " x " + std::to_string(c.height);
  };
  if (left.width != right.width || left.height != right.height)
    return fail("the imagers of a stereo pair differ in size (" + size(left) + " and " +
                size(right) + "); give two cameras of one size");
  if (left.width < 2 || left.height < 2 ||
      static_cast<std::size_t>(left.width) * static_cast<std::size_t>(left.height) >
          kImagePixelsMax)
    return fail("a stereo pair cannot be rectified at " + size(left) + " pixels");
  const Eigen::Matrix3d R_LR = X_LR.rotation.toRotationMatrix();
  const double baseline = X_LR.position.norm();
  const Eigen::Vector3d x = X_LR.position / baseline;
  if (!(baseline > 1e-6) || x.x() < 0.5)
    return fail("the right imager is not to the right of the left one (its place is x = " +
                std::to_string(X_LR.position.x()) + " m, y = " + std::to_string(X_LR.position.y()) +
                " m there); exchange the imagers");
  const Eigen::Vector3d axis = (Eigen::Vector3d::UnitZ() + R_LR.col(2)).normalized();
  const Eigen::Vector3d y = axis.cross(x).normalized();
  Eigen::Matrix3d R_LS;
  R_LS << x, y, x.cross(y);
  const Eigen::Matrix3d R_RS = R_LR.transpose() * R_LS;

  StereoRectification result;
  Camera& camera = result.camera;
  camera.width = left.width;
  camera.height = left.height;
  camera.fx = camera.fy = options.zoom * (left.fx + left.fy + right.fx + right.fy) / 4;
  const Eigen::Vector2d middle = (middle_on_plane(left, R_LS.transpose(), camera.fx) +
                                  middle_on_plane(right, R_RS.transpose(), camera.fx)) /
                                 2;
  camera.cx = (camera.width - 1) / 2.0 - middle.x();
  camera.cy = (camera.height - 1) / 2.0 - middle.y();
  result.baseline = baseline;
  result.X_LS = {Eigen::Quaterniond(R_LS), Eigen::Vector3d::Zero()};
  result.X_RS = X_LR.inverse() * result.X_LS;
  result.left = make_table(camera, left, R_LS);
  result.right = make_table(camera, right, R_RS);
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

}  // namespace wagonsight
