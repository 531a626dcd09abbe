#pragma once

#include <Eigen/Core>
#include <vector>

#include "rig/rig.h"

namespace wagonsight {

// To within how many metres (one sigma, root of the trace of the 3 x 3 covariance) a point would be
// placed in W by the best of the sensors that see it, on a grid at one height above W's floor.
struct UncertaintyMap {
  struct Cell {
    int seen_by = 0;     // sensors
    int best = -1;       // index of the sensor, -1: seen by none
    double pose_m = 0;   // from the uncertainty of the sensor's pose alone
    double total_m = 0;  // with the noise of one reading of it
  };
  double height_m = 1.0;
  double cell_m = 0.1;
  Eigen::Vector2d corner = Eigen::Vector2d::Zero();  // of the cell at column 0, row 0 (least x, y)
  int columns = 0, rows = 0;
  std::vector<Cell> cells;  // row by row, along x

  const Cell& at(int column, int row) const {
    return cells[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
                 static_cast<std::size_t>(column)];
  }
  // Of the cells that are seen; 0 when none is.
  double median_pose_m() const;
  double median_total_m() const;
};

// First-order propagation of RigSensor::covariance and noise. What stands in the way (seats, walls)
// is not known to a rig; a stereo sensor's texture neither. The grid covers what the sensors see
// within their trim at that height, 30 m at most.
UncertaintyMap map_uncertainty(const Rig& rig, double height_m = 1.0, double cell_m = 0.1);

// The covariance (m^2, in W) of a point that `sensor` sees at p_W: of its pose alone and in all.
struct PointCovariance {
  Eigen::Matrix3d pose, total;
};
PointCovariance point_covariance(const RigSensor& sensor, const Eigen::Vector3d& p_W);

}  // namespace wagonsight
