#pragma once

#include <Eigen/Geometry>

namespace wagonsight {

// Photogrammetry's rotation angles, radians, with R = Rz(kappa) Ry(phi) Rx(omega): the order
// (Z, Y, X, then the translation) of the paper's Table 3.
struct OmegaPhiKappa {
  double omega = 0, phi = 0, kappa = 0;
};

// omega and kappa in (-pi, pi], phi in [-pi/2, pi/2]; at |phi| = pi/2 kappa is set to zero.
OmegaPhiKappa to_omega_phi_kappa(const Eigen::Quaterniond& rotation);
Eigen::Quaterniond from_omega_phi_kappa(const OmegaPhiKappa& angles);

// The angle folded into (-pi, pi].
double wrap_angle(double radians);

// The camera orientation that looks from `position` to `target` with the image upright (world z
// up): R_WS of X_WS. A camera that looks straight up or down gets its image top towards world +y.
Eigen::Quaterniond look_at(const Eigen::Vector3d& position, const Eigen::Vector3d& target);

}  // namespace wagonsight
