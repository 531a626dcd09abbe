#include "stereo/rectify.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <vector>

#include "stereo/rectify_kernels.h"
#include "support/sanitized.h"

namespace wagonsight {
namespace {

Camera camera_of(int width, int height, double focal, std::array<double, 5> distortion) {
  return {width, height, focal, focal * 1.002, width / 2.0 + 3, height / 2.0 - 2, distortion};
}

Rigid pose_of(std::mt19937& random) {
  std::uniform_real_distribution<double> turn(-0.04, 0.04), shift(-0.006, 0.006);
  const Eigen::Vector3d axis(turn(random), turn(random), turn(random));
  return {Eigen::Quaterniond(Eigen::AngleAxisd(axis.norm(), axis.normalized())),
          Eigen::Vector3d(0.08 + shift(random), shift(random), shift(random))};
}

class Rectification : public testing::TestWithParam<int> {};

// Points in space fall onto one row, at the disparity f b / z; and the tables fetch each rectified
// pixel from where the distorted cameras see the same point.
TEST_P(Rectification, PointsLieOnOneRowAndTablesAgreeWithTheCameras) {
  std::mt19937 random(static_cast<unsigned>(GetParam()));
  std::uniform_real_distribution<double> k(-0.2, 0.1), p(-0.002, 0.002), u(20, 748), v(20, 427),
      z(0.6, 5.0);
  const Camera left = camera_of(769, 448, 520, {k(random), 0.05, p(random), p(random), 0.01});
  const Camera right = camera_of(769, 448, 523, {k(random), 0.03, p(random), p(random), 0.0});
  const Rigid X_LR = pose_of(random);
  const auto made = make_rectification(left, right, X_LR);
  ASSERT_TRUE(made);
  const StereoRectification& r = *made;
  EXPECT_NEAR(r.baseline, X_LR.position.norm(), 1e-12);
  int inside = 0;
  for (int n = 0; n < 200; ++n) {
    const double depth = z(random);
    const double pu = std::round(u(random)), pv = std::round(v(random));
    const Eigen::Vector3d p_S(depth * (pu - r.camera.cx) / r.camera.fx,
                              depth * (pv - r.camera.cy) / r.camera.fy, depth);
    // The rectified right imager has the left one's axes and stands one baseline to the right.
    const auto seen_right = project(r.camera, p_S - Eigen::Vector3d(r.baseline, 0, 0));
    ASSERT_TRUE(seen_right);
    EXPECT_NEAR(seen_right->y(), pv, 1e-9);
    EXPECT_NEAR(pu - seen_right->x(), r.camera.fx * r.baseline / depth, 1e-9);
    // What the left table fetches for (pu, pv) is where the left camera sees the point.
    const auto at = static_cast<std::size_t>(pv) * 769 + static_cast<std::size_t>(pu);
    const auto source = project(left, r.X_LS * p_S);
    ASSERT_TRUE(source);
    const RectifyEntry entry = r.left[at];
    const bool sees = source->x() > 1 && source->x() < 767 && source->y() > 1 && source->y() < 446;
    if (!sees) continue;
    ++inside;
    ASSERT_NE(entry, kOutsideSource);
    EXPECT_NEAR((entry >> 10) % 769 + (entry & 31) / 32.0, source->x(), 0.5 / 32 + 1e-9);
    EXPECT_NEAR((entry >> 10) / 769 + (entry >> 5 & 31) / 32.0, source->y(), 0.5 / 32 + 1e-9);
  }
  EXPECT_GT(inside, 100);
  // A far point's pixel is the same in both rectified images: the right table is held to that.
  const Eigen::Vector3d far = 1e6 * Eigen::Vector3d(0.05, 0.03, 1);
  const auto pixel = project(r.camera, far);
  const auto expected = project(right, X_LR.inverse() * (r.X_LS * far));
  ASSERT_TRUE(pixel && expected);
  const RectifyEntry entry = r.right[static_cast<std::size_t>(std::lround(pixel->y())) * 769 +
                                     static_cast<std::size_t>(std::lround(pixel->x()))];
  EXPECT_NEAR((entry >> 10) % 769 + (entry & 31) / 32.0, expected->x(), 0.6);
  EXPECT_NEAR((entry >> 10) / 769 + (entry >> 5 & 31) / 32.0, expected->y(), 0.6);
}

// Random tables over random images of odd sizes: this processor's build against the scalar one.
TEST_P(Rectification, EveryBuildGivesTheSameBytes) {
  std::mt19937 random(static_cast<unsigned>(GetParam()));
  const auto between = [&](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
  };
  const int width = between(2, 60), height = between(2, 40);
  const auto size = static_cast<std::size_t>(width * height);
  std::vector<RectifyEntry> table(static_cast<std::size_t>(between(0, 300)));
  for (auto& entry : table) {
    const int index = between(0, height - 2) * width + between(0, width - 2);
    entry = between(0, 9) == 0
                ? kOutsideSource
                : static_cast<RectifyEntry>(index << 10 | between(0, 31) << 5 | between(0, 31));
  }
  std::vector<std::uint16_t> wide(size), wide_out[2];
  std::vector<std::uint8_t> narrow(size), narrow_out[2];
  for (auto& pixel : wide) pixel = static_cast<std::uint16_t>(between(0, 32767));
  for (auto& pixel : narrow) pixel = static_cast<std::uint8_t>(between(0, 255));
  const stereo_kernels::ResampleRun run{table.data(), table.size(), width, size};
  for (std::size_t k = 0; k < 2; ++k) {
    const auto& kernels =
        k == 0 ? stereo_kernels::scalar_resample() : stereo_kernels::best_resample();
    wide_out[k].resize(table.size());
    narrow_out[k].resize(table.size());
    kernels.gray16(run, wide.data(), wide_out[k].data());
    kernels.gray8(run, narrow.data(), narrow_out[k].data());
  }
  EXPECT_EQ(wide_out[0], wide_out[1]);
  EXPECT_EQ(narrow_out[0], narrow_out[1]);
}

INSTANTIATE_TEST_SUITE_P(Seeds, Rectification, testing::Range(0, test::cases(20, 5)));

TEST(Rectify, ARampStaysARamp) {
  // A cameras' pair without distortion or turn: rectified pixels come from a shifted ramp.
  const Camera camera = camera_of(64, 48, 60, {});
  const Rigid X_LR{Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.1, 0, 0)};
  const auto made = make_rectification(camera, camera, X_LR);
  ASSERT_TRUE(made);
  std::vector<std::uint16_t> ramp(64 * 48), out(64 * 48);
  for (std::size_t k = 0; k < ramp.size(); ++k)
    ramp[k] = static_cast<std::uint16_t>(100 + 10 * (k % 64) + 20 * (k / 64));
  rectify({ramp.data(), PixelFormat::kGray16, 64, 48}, made->left, out.data());
  int compared = 0;
  for (int v = 2; v < 46; ++v)
    for (int u = 2; u < 62; ++u) {
      const Eigen::Vector3d ray((u - made->camera.cx) / made->camera.fx,
                                (v - made->camera.cy) / made->camera.fy, 1);
      const auto source = project(camera, made->X_LS * ray);
      if (source->x() < 1 || source->x() > 62 || source->y() < 1 || source->y() > 46) continue;
      ++compared;
      EXPECT_NEAR(out[static_cast<std::size_t>(v * 64 + u)],
                  100 + 10 * source->x() + 20 * source->y(), 1.0);
    }
  EXPECT_GT(compared, 2000);
}

TEST(Rectify, SaysWhyAPairCannotBeRectified) {
  const Camera camera = camera_of(64, 48, 60, {});
  const Rigid exchanged{Eigen::Quaterniond::Identity(), Eigen::Vector3d(-0.1, 0, 0)};
  const auto wrong_side = make_rectification(camera, camera, exchanged);
  ASSERT_FALSE(wrong_side);
  EXPECT_THAT(wrong_side.error().message, testing::HasSubstr("exchange the imagers"));
  const auto other_size =
      make_rectification(camera, camera_of(65, 48, 60, {}), exchanged.inverse());
  ASSERT_FALSE(other_size);
  EXPECT_THAT(other_size.error().message, testing::HasSubstr("differ in size"));
}

TEST(Rectify, WhatTheSourceDoesNotSeeIsBlack) {
  const Camera camera = camera_of(64, 48, 60, {});
  const Rigid X_LR{Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitY())),
                   Eigen::Vector3d(0.1, 0, 0)};
  const auto made = make_rectification(camera, camera, X_LR);
  ASSERT_TRUE(made);
  const std::vector<std::uint8_t> white(64 * 48, 200);
  std::vector<std::uint8_t> out(64 * 48);
  rectify({white.data(), PixelFormat::kGray8, 64, 48}, made->left, out.data());
  for (std::size_t k = 0; k < out.size(); ++k)
    EXPECT_EQ(out[k], made->left[k] == kOutsideSource ? 0 : 200);
  EXPECT_THAT(out, testing::Contains(0));
  EXPECT_THAT(out, testing::Contains(200));
}

TEST(Rectify, APartIsThatPartOfTheWhole) {
  const Camera camera = camera_of(75, 48, 60, {});
  const Rigid X_LR{Eigen::Quaterniond(Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitY())),
                   Eigen::Vector3d(0.1, 0.01, 0)};
  const auto made = make_rectification(camera, camera, X_LR);
  ASSERT_TRUE(made);
  std::vector<std::uint16_t> source(75 * 48);
  for (std::size_t k = 0; k < source.size(); ++k)
    source[k] = static_cast<std::uint16_t>((k * 2654435761U >> 7) % 4096);
  const GrayImage image{source.data(), PixelFormat::kGray16, 75, 48};
  std::vector<std::uint16_t> whole(75 * 48);
  rectify(image, made->right, whole.data());
  for (const PixelRect part : {PixelRect{0, 0, 75, 48}, PixelRect{17, 5, 40, 6},
                               PixelRect{70, 40, 75, 48}, PixelRect{3, 9, 3, 12}}) {
    std::vector<std::uint16_t> out(75 * 48, 9999);
    rectify_part(image, made->right, part, out.data());
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 75; ++x) {
        const auto at = static_cast<std::size_t>(y * 75 + x);
        const bool inside = x >= part.x0 && x < part.x1 && y >= part.y0 && y < part.y1;
        if (inside || out[at] != 9999) {
          EXPECT_EQ(out[at], whole[at]) << x << ' ' << y;
        }
      }
  }
}

}  // namespace
}  // namespace wagonsight
