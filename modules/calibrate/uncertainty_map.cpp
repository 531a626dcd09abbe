#include "calibrate/uncertainty_map.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

namespace wagonsight {
namespace {

constexpr double kExtentMax = 30;       // metres
constexpr double kPixelSigma = 0.2887;  // of a reading's place within its pixel: 1 / sqrt(12)

bool sees(const RigSensor& sensor, const Eigen::Vector3d& p_S) {
  if (p_S.z() < sensor.trim_near || p_S.z() > sensor.trim_far) return false;
  const auto pixel = project(sensor.camera, p_S);
  return pixel && pixel->x() >= 0 && pixel->y() >= 0 && pixel->x() <= sensor.camera.width - 1 &&
         pixel->y() <= sensor.camera.height - 1;
}

// Where the rays of a sensor meet the plane at `height_m`, within its trim.
void add_footprint(const RigSensor& sensor, double height_m, Eigen::AlignedBox2d& box) {
  constexpr int kAcross = 24;
  for (int i = 0; i <= kAcross; ++i)
    for (int j = 0; j <= kAcross; ++j) {
      const Eigen::Vector2d pixel((sensor.camera.width - 1) * static_cast<double>(i) / kAcross,
                                  (sensor.camera.height - 1) * static_cast<double>(j) / kAcross);
      const auto ray = ray_through(sensor.camera, pixel);
      if (!ray) continue;
      const Eigen::Vector3d along = sensor.X_WS.rotation * *ray;
      const double depth = (height_m - sensor.X_WS.position.z()) / along.z();
      if (!(depth > 0)) continue;
      const double used = std::clamp(depth, sensor.trim_near, sensor.trim_far);
      if (used != depth) continue;
      box.extend((sensor.X_WS.position + depth * along).head<2>().eval());
    }
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

PointCovariance point_covariance(const RigSensor& sensor, const Eigen::Vector3d& p_W) {
  const Eigen::Matrix3d R = sensor.X_WS.rotation.toRotationMatrix();
  const Eigen::Vector3d p_S = sensor.X_WS.inverse() * p_W;
  const Eigen::Vector3d arm = R * p_S;
  // p_W = exp(rotation) R p_S + position, so its change is rotation x (R p_S) + change of position.
  Eigen::Matrix<double, 3, 6> J;
  J << 0, arm.z(), -arm.y(), 1, 0, 0,  //
      -arm.z(), 0, arm.x(), 0, 1, 0,   //
      arm.y(), -arm.x(), 0, 0, 0, 1;
  PointCovariance result;
  result.pose = J * sensor.covariance * J.transpose();
  const double z = p_S.z(), sigma = sensor.noise.sigma(z), step = sensor.noise.step(z);
  const Eigen::Vector3d ray = p_S / z;
  const double across_x = kPixelSigma * z / sensor.camera.fx;
  const double across_y = kPixelSigma * z / sensor.camera.fy;
  const Eigen::Matrix3d reading =
      (sigma * sigma + step * step / 12) * ray * ray.transpose() +
      Eigen::Vector3d(across_x * across_x, across_y * across_y, 0).asDiagonal().toDenseMatrix();
  result.total = result.pose + R * reading * R.transpose();
  return result;
}

UncertaintyMap map_uncertainty(const Rig& rig, double height_m, double cell_m) {
  UncertaintyMap map;
  map.height_m = height_m;
  map.cell_m = cell_m;
  Eigen::AlignedBox2d box;
  for (const RigSensor& sensor : rig.sensors) add_footprint(sensor, height_m, box);
  if (box.isEmpty()) return map;
  map.corner = (box.min() / cell_m).array().floor() * cell_m;
  const Eigen::Vector2d extent = (box.max() - map.corner).cwiseMin(kExtentMax);
  map.columns = std::max(1, static_cast<int>(std::ceil(extent.x() / cell_m)));
  map.rows = std::max(1, static_cast<int>(std::ceil(extent.y() / cell_m)));
  map.cells.resize(static_cast<std::size_t>(map.columns) * static_cast<std::size_t>(map.rows));
  for (int row = 0; row < map.rows; ++row)
    for (int column = 0; column < map.columns; ++column) {
      UncertaintyMap::Cell& cell =
          map.cells[static_cast<std::size_t>(row) * static_cast<std::size_t>(map.columns) +
                    static_cast<std::size_t>(column)];
      const Eigen::Vector3d p_W(map.corner.x() + (column + 0.5) * cell_m,
                                map.corner.y() + (row + 0.5) * cell_m, height_m);
      for (std::size_t s = 0; s < rig.sensors.size(); ++s) {
        const RigSensor& sensor = rig.sensors[s];
        if (!sees(sensor, sensor.X_WS.inverse() * p_W)) continue;
        ++cell.seen_by;
        const PointCovariance covariance = point_covariance(sensor, p_W);
        const double total = std::sqrt(covariance.total.trace());
        if (cell.best >= 0 && total >= cell.total_m) continue;
        cell.best = static_cast<int>(s);
        cell.total_m = total;
        cell.pose_m = std::sqrt(covariance.pose.trace());
      }
    }
  return map;
}

double UncertaintyMap::median_pose_m() const {
  std::vector<double> values;
  for (const Cell& cell : cells)
    if (cell.seen_by > 0) values.push_back(cell.pose_m);
  return median(std::move(values));
}

double UncertaintyMap::median_total_m() const {
  std::vector<double> values;
  for (const Cell& cell : cells)
    if (cell.seen_by > 0) values.push_back(cell.total_m);
  return median(std::move(values));
}

}  // namespace wagonsight
