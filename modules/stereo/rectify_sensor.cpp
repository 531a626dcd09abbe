#include "stereo/rectify_sensor.h"

#include <fmt/format.h>

#include <cmath>

namespace wagonsight {
namespace {

bool same(const Camera& a, const Camera& b) {
  constexpr double kNothing_px = 1e-3;
  const auto near = [](double x, double y) { return std::abs(x - y) < kNothing_px; };
  return a.width == b.width && a.height == b.height && near(a.fx, b.fx) && near(a.fy, b.fy) &&
         near(a.cx, b.cx) && near(a.cy, b.cy) && !a.has_distortion() && !b.has_distortion();
}

}  // namespace

Result<StereoRectification> rectification_of(const RigSensor& sensor) {
  const StereoGeometry& stereo = sensor.stereo;
  if (!stereo.has_lenses()) {
    StereoRectification rectified;
    rectified.camera = sensor.camera;
    rectified.baseline = stereo.baseline;
    return rectified;
  }
  auto rectification = make_rectification(stereo.left, stereo.right, stereo.X_LR);
  if (!rectification)
    return fail(fmt::format("sensor {}: {}", sensor.name.view(), rectification.error().message));
  if (!same(rectification->camera, sensor.camera))
    return fail(
        fmt::format("sensor {}: its rectified camera is not the one that follows from its "
                    "lenses; pack the calibration again",
                    sensor.name.view()));
  return rectification;
}

}  // namespace wagonsight
