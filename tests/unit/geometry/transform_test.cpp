#include "geometry/transform.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <numbers>

#include "arbitrary.h"
#include "geometry/angles.h"

namespace wagonsight {
namespace {

constexpr double kPi = std::numbers::pi;

bool near(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double tolerance = 1e-9) {
  return (a - b).norm() <= tolerance;
}

// The oracle: 4x4 matrices.
Eigen::Matrix4d matrix_of(double scale, const Eigen::Quaterniond& q, const Eigen::Vector3d& p) {
  Eigen::Matrix4d M = Eigen::Matrix4d::Identity();
  M.topLeftCorner<3, 3>() = scale * q.toRotationMatrix();
  M.topRightCorner<3, 1>() = p;
  return M;
}
Eigen::Vector3d apply(const Eigen::Matrix4d& M, const Eigen::Vector3d& p) {
  return (M * p.homogeneous()).head<3>();
}

RC_GTEST_PROP(Rigid, ComposesAndInvertsAsMatricesDo, ()) {
  const Rigid X_AB = test::rigid(), X_BC = test::rigid();
  const Eigen::Vector3d p_C = test::vector_in(10);
  const Eigen::Matrix4d M_AB = matrix_of(1, X_AB.rotation, X_AB.position);
  const Eigen::Matrix4d M_BC = matrix_of(1, X_BC.rotation, X_BC.position);
  RC_ASSERT(near((X_AB * X_BC) * p_C, apply(M_AB * M_BC, p_C)));
  RC_ASSERT(near(X_AB.inverse() * p_C, apply(M_AB.inverse(), p_C)));
  RC_ASSERT(near(X_AB.inverse() * (X_AB * p_C), p_C));
}

RC_GTEST_PROP(Similarity, ComposesAndInvertsAsMatricesDo, ()) {
  const Similarity X_AB = test::similarity(), X_BC = test::similarity();
  const Eigen::Vector3d p_C = test::vector_in(10);
  const Eigen::Matrix4d M_AB = matrix_of(X_AB.scale, X_AB.rotation, X_AB.position);
  const Eigen::Matrix4d M_BC = matrix_of(X_BC.scale, X_BC.rotation, X_BC.position);
  RC_ASSERT(near((X_AB * X_BC) * p_C, apply(M_AB * M_BC, p_C), 1e-8));
  RC_ASSERT(near(X_AB.inverse() * p_C, apply(M_AB.inverse(), p_C), 1e-8));
}

RC_GTEST_PROP(OmegaPhiKappa, RoundTripsEveryRotation, ()) {
  const Eigen::Quaterniond rotation = test::rotation();
  const Eigen::Quaterniond back = from_omega_phi_kappa(to_omega_phi_kappa(rotation));
  RC_ASSERT(rotation.angularDistance(back) < 1e-7);
}

RC_GTEST_PROP(OmegaPhiKappa, RoundTripsEveryTripleOfAngles, ()) {
  const OmegaPhiKappa in{test::real_in(-3.1, 3.1), test::real_in(-1.55, 1.55),
                         test::real_in(-3.1, 3.1)};
  const OmegaPhiKappa out = to_omega_phi_kappa(from_omega_phi_kappa(in));
  RC_ASSERT(std::abs(in.omega - out.omega) < 1e-9);
  RC_ASSERT(std::abs(in.phi - out.phi) < 1e-9);
  RC_ASSERT(std::abs(in.kappa - out.kappa) < 1e-9);
}

TEST(OmegaPhiKappa, IsRzRyRx) {
  const OmegaPhiKappa angles{0.1, -0.2, 0.3};
  const auto c = [](double a) { return std::cos(a); };
  const auto s = [](double a) { return std::sin(a); };
  Eigen::Matrix3d Rx, Ry, Rz;
  Rx << 1, 0, 0, 0, c(0.1), -s(0.1), 0, s(0.1), c(0.1);
  Ry << c(-0.2), 0, s(-0.2), 0, 1, 0, -s(-0.2), 0, c(-0.2);
  Rz << c(0.3), -s(0.3), 0, s(0.3), c(0.3), 0, 0, 0, 1;
  EXPECT_TRUE(from_omega_phi_kappa(angles).toRotationMatrix().isApprox(Rz * Ry * Rx, 1e-12));
}

TEST(OmegaPhiKappa, StandsTheGimbalLock) {
  for (const double phi : {kPi / 2, -kPi / 2}) {
    const Eigen::Quaterniond rotation = from_omega_phi_kappa({0.4, phi, 0.3});
    const OmegaPhiKappa angles = to_omega_phi_kappa(rotation);
    EXPECT_EQ(angles.kappa, 0);
    EXPECT_NEAR(angles.phi, phi, 1e-7);
    EXPECT_LT(from_omega_phi_kappa(angles).angularDistance(rotation), 1e-7);
  }
}

RC_GTEST_PROP(WrapAngle, IsTheSameDirectionInRange, ()) {
  const double angle = test::real_in(-100, 100);
  const double wrapped = wrap_angle(angle);
  RC_ASSERT(wrapped > -kPi - 1e-12);
  RC_ASSERT(wrapped <= kPi + 1e-12);
  RC_ASSERT(std::abs(std::remainder(angle - wrapped, 2 * kPi)) < 1e-9);
}

TEST(WrapAngle, KeepsPiPositive) {
  EXPECT_DOUBLE_EQ(wrap_angle(-kPi), kPi);
  EXPECT_DOUBLE_EQ(wrap_angle(kPi), kPi);
  EXPECT_DOUBLE_EQ(wrap_angle(3 * kPi / 2), -kPi / 2);
}

RC_GTEST_PROP(LookAt, LooksThereWithTheImageUpright, ()) {
  const Eigen::Vector3d position = test::vector_in(5), target = test::vector_in(5);
  RC_PRE((target - position).head<2>().norm() > 1e-3);
  const Eigen::Matrix3d R_WS = look_at(position, target).toRotationMatrix();
  RC_ASSERT(near(R_WS.col(2), (target - position).normalized(), 1e-6));
  RC_ASSERT(std::abs(R_WS(2, 0)) < 1e-6);  // x of S, the image's rows, is level
  RC_ASSERT(R_WS(2, 1) < 1e-6);            // y of S, down the image, never points up
  RC_ASSERT(std::abs(R_WS.determinant() - 1) < 1e-9);
}

TEST(LookAt, StraightDownHasItsTopTowardsY) {
  const Eigen::Matrix3d R_WS = look_at({1, 1, 2.4}, {1, 1, 0}).toRotationMatrix();
  EXPECT_TRUE(near(R_WS.col(2), {0, 0, -1}));
  EXPECT_TRUE(near(R_WS.col(1), {0, -1, 0}));  // down the image is -y
}

}  // namespace
}  // namespace wagonsight
