#include "calibrate/pack.h"

#include <gtest/gtest.h>

#include "rig/blob.h"
#include "stereo/rectify.h"
#include "support/synthetic_rig.h"

namespace wagonsight {
namespace {

TEST(Pack, AStereoCameraIsTheRectifiedLeftImagerAsTheUnitWillRectifyIt) {
  const auto truth = synthetic::make(3, {.poses = 2, .kinects = 1, .stereos = 2});
  Solution solution = synthetic::true_solution(truth);
  solution.georeference.emplace().X_WB = {
      1.02, from_omega_phi_kappa({3.1, 0.02, -1.5}), {1.0, 2.5, 0.1}};
  const auto rig = to_rig(solution);
  ASSERT_TRUE(rig) << rig.error().message;
  ASSERT_EQ(rig->sensors.size(), 3U);
  const RigSensor& pair = rig->sensors[1];
  EXPECT_EQ(pair.name.view(), "s0");
  EXPECT_NEAR(pair.stereo.baseline, 1.02 * 0.08, 1e-9);
  const auto rectified = make_rectification(pair.stereo.left, pair.stereo.right, pair.stereo.X_LR);
  ASSERT_TRUE(rectified) << rectified.error().message;
  EXPECT_EQ(rectified->camera.fx, pair.camera.fx);
  EXPECT_EQ(rectified->camera.cx, pair.camera.cx);
  EXPECT_EQ(rectified->camera.cy, pair.camera.cy);
  // A point of the world lands in the left lens where its rectified pixel says, on one row in both.
  const Eigen::Vector3d p_W = pair.X_WS * Eigen::Vector3d(0.2, -0.1, 1.7);
  const Eigen::Vector3d p_S = pair.X_WS.inverse() * p_W;
  const Eigen::Vector3d p_B = solution.georeference->X_WB.inverse() * p_W;
  const auto in_left = project(truth.cameras[1], truth.X_BS[1].inverse() * p_B);
  const auto from_rig = project(pair.stereo.left, rectified->X_LS * p_S);
  ASSERT_TRUE(in_left && from_rig);
  EXPECT_NEAR((*in_left - *from_rig).norm(), 0, 1e-6);
  const auto in_right = project(truth.cameras[2], truth.X_BS[2].inverse() * p_B);
  const auto right_from_rig = project(pair.stereo.right, rectified->X_RS * p_S);
  ASSERT_TRUE(in_right && right_from_rig);
  EXPECT_NEAR((*in_right - *right_from_rig).norm(), 0, 1e-6);
}

TEST(Pack, TheBlobCarriesWhatRectificationNeeds) {
  const auto truth = synthetic::make(4, {.poses = 2, .kinects = 1, .stereos = 1});
  const auto rig = to_rig(synthetic::true_solution(truth));
  ASSERT_TRUE(rig) << rig.error().message;
  const auto bytes = pack_blob(*rig);
  const auto blob = open_blob(bytes);
  ASSERT_TRUE(blob) << blob.error().message;
  EXPECT_FALSE(blob->rig.sensors[0].stereo.has_lenses());
  ASSERT_TRUE(blob->rig.sensors[1].stereo.has_lenses());
  EXPECT_EQ(blob->rig.sensors[1].stereo.right.cx, truth.cameras[2].cx);
  EXPECT_FALSE(blob->rays[0].empty());
}

}  // namespace
}  // namespace wagonsight
