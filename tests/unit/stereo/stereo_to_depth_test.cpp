#include "stereo/stereo_to_depth.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>
#include <vector>

#include "support/allocation_counter.h"
#include "support/sanitized.h"

namespace wagonsight {
namespace {

using testing_support::allocation_count;

constexpr int kWidth = 321, kHeight = 241;
constexpr double kWallZ = 3.0, kBoxZ = 2.0;

// A texture of two scales, 12 bit, everywhere defined.
double texture(double x, double y) {
  const auto hash = [](int i, int j) {
    auto h =
        static_cast<std::uint32_t>(i) * 374761393U + static_cast<std::uint32_t>(j) * 668265263U;
    h = (h ^ (h >> 13)) * 1274126177U;
    return static_cast<double>((h ^ (h >> 16)) & 1023U);
  };
  const auto smooth = [&](double u, double v) {
    const double fu = std::floor(u), fv = std::floor(v), a = u - fu, b = v - fv;
    const int i = static_cast<int>(fu), j = static_cast<int>(fv);
    return (1 - b) * ((1 - a) * hash(i, j) + a * hash(i + 1, j)) +
           b * ((1 - a) * hash(i, j + 1) + a * hash(i + 1, j + 1));
  };
  return 300 + smooth(60 * x, 60 * y) + smooth(25 * x + 100, 25 * y);
}

// What an imager sees of a wall at z = kWallZ and, if asked for, a box before it, both given in the
// left camera's frame; X_LC maps from the imager to it.
void render(const Camera& camera, const Rigid& X_LC, bool with_box, std::uint16_t* out) {
  for (int v = 0; v < kHeight; ++v)
    for (int u = 0; u < kWidth; ++u) {
      const auto ray = ray_through(camera, {double(u), double(v)});
      const Eigen::Vector3d direction = X_LC.rotation * ray.value_or(Eigen::Vector3d::UnitZ());
      const auto hit = [&](double z) -> Eigen::Vector3d {
        return X_LC.position + direction * ((z - X_LC.position.z()) / direction.z());
      };
      Eigen::Vector3d p = hit(kWallZ);
      const Eigen::Vector3d near = hit(kBoxZ);
      if (with_box && std::abs(near.x()) < 0.3 && std::abs(near.y()) < 0.4)
        p = near + Eigen::Vector3d(5, 3, 0);  // another piece of the texture
      *out++ = static_cast<std::uint16_t>(texture(p.x(), p.y()));
    }
}

class StereoToDepthTest : public testing::TestWithParam<MatcherMode> {
 protected:
  Camera left_{kWidth, kHeight, 300, 300, 158, 121, {-0.12, 0.03, 0.001, -0.0005, 0}};
  Camera right_{kWidth, kHeight, 302, 301, 162, 118, {-0.1, 0.02, -0.001, 0.0005, 0}};
  Rigid X_LR_{
      Eigen::Quaterniond(Eigen::AngleAxisd(0.02, Eigen::Vector3d(0.3, -0.8, 0.5).normalized())),
      Eigen::Vector3d(0.12, 0.002, -0.003)};
  std::vector<std::uint16_t> pixels_ = std::vector<std::uint16_t>(2 * kWidth * kHeight);
  FrameSlot slot_;
  std::unique_ptr<StereoWorkspace> workspace_;

  void SetUp() override {
    slot_.format = PixelFormat::kGray16;
    slot_.width = kWidth;
    slot_.height = kHeight;
    slot_.bytes = std::as_writable_bytes(std::span(pixels_));
  }
  StereoToDepth made() {
    auto rectification = make_rectification(left_, right_, X_LR_);
    EXPECT_TRUE(rectification);
    StereoToDepthOptions options;
    options.matcher.mode = GetParam();
    options.matcher.disparity_count = 32;
    options.whole_every_s = 3.0;
    options.aligned_every_s = 0.5;
    if (workspace_ == nullptr)
      workspace_ = *StereoWorkspace::create(kWidth, kHeight, options.matcher);
    return StereoToDepth(std::move(*rectification), options);
  }
  void take(double seconds, bool with_box) {
    slot_.instant = HostTime(from_seconds(seconds));
    render(left_, Rigid{}, with_box, pixels_.data());
    render(right_, X_LR_, with_box, pixels_.data() + kWidth * kHeight);
  }
};

// The share of pixels with a depth, and of those whose depth is three sigmas off `z`.
struct Quality {
  double density, off;
};
Quality quality(const DepthImage& depth, const StereoToDepth& stereo, const Rigid& X_LS, double z,
                const PixelRect& rect) {
  const RigSensor sensor = stereo_sensor({stereo.camera(), 0.12, Rigid{}, Rigid{}, {}, {}});
  int count = 0, valid = 0, off = 0;
  for (int v = rect.y0; v < rect.y1; ++v)
    for (int u = rect.x0; u < rect.x1; ++u) {
      ++count;
      if (depth.at(u, v) == 0) continue;
      ++valid;
      const double metres = depth.at(u, v) / 1000.0;
      const Eigen::Vector3d p_L =
          X_LS * (metres * *ray_through(stereo.camera(), {double(u), double(v)}));
      off += std::abs(p_L.z() - z) > 3 * sensor.noise.sigma(z);
    }
  return {double(valid) / count, double(off) / std::max(valid, 1)};
}

TEST_P(StereoToDepthTest, DepthsOfAWallLieWithinTheStatedNoise) {
  StereoToDepth stereo = made();
  take(0.0, false);
  const DepthImage depth = stereo.convert(slot_, false, {}, *workspace_);
  const Rigid X_LS = make_rectification(left_, right_, X_LR_)->X_LS;
  const Quality found = quality(depth, stereo, X_LS, kWallZ, {60, 20, 300, 220});
  EXPECT_GT(found.density, 0.95);
  EXPECT_LT(found.off, 0.01);
  EXPECT_EQ(stereo.report().matched_share, 1.0);
}

TEST_P(StereoToDepthTest, OnlyWhatChangedIsMatchedAndTheRestIsKept) {
  StereoToDepth stereo = made();
  take(0.0, false);
  stereo.convert(slot_, false, {}, *workspace_);
  take(0.1, true);
  const DepthImage with_box = stereo.convert(slot_, false, {}, *workspace_);
  const Rigid X_LS = make_rectification(left_, right_, X_LR_)->X_LS;
  EXPECT_LT(stereo.report().matched_share, 0.6);
  EXPECT_GT(stereo.report().matched_share, 0.1);
  EXPECT_LT(quality(with_box, stereo, X_LS, kBoxZ, {140, 80, 180, 160}).off, 0.02);
  EXPECT_LT(quality(with_box, stereo, X_LS, kWallZ, {240, 20, 300, 220}).off, 0.02);
  take(0.2, true);
  stereo.convert(slot_, false, {}, *workspace_);
  EXPECT_EQ(stereo.report().matched_share, 0);  // nothing moved
  take(0.3, false);
  const DepthImage gone = stereo.convert(slot_, false, {}, *workspace_);
  EXPECT_LT(quality(gone, stereo, X_LS, kWallZ, {140, 80, 180, 160}).off, 0.02);
  take(3.5, false);
  stereo.convert(slot_, false, {}, *workspace_);
  EXPECT_EQ(stereo.report().matched_share, 1.0);  // at its slow rhythm
}

TEST_P(StereoToDepthTest, ConvertingAllocatesNothing) {
  StereoToDepth stereo = made();
  take(0.0, false);
  const long before_first = allocation_count();
  stereo.convert(slot_, true, {}, *workspace_);
  EXPECT_EQ(allocation_count(), before_first);
  take(0.1, true);
  const PixelRect feedback{10, 10, 60, 80};
  const long before = allocation_count();
  stereo.convert(slot_, false, {&feedback, 1}, *workspace_);
  EXPECT_EQ(allocation_count(), before);
}

TEST_P(StereoToDepthTest, ASlotThatDoesNotFitIsRefusedAndCounted) {
  StereoToDepth stereo = made();
  slot_.width = kWidth - 1;
  EXPECT_EQ(stereo.convert(slot_, false, {}, *workspace_).pixels, nullptr);
  slot_.width = kWidth;
  slot_.format = PixelFormat::kRgb8;
  EXPECT_EQ(stereo.convert(slot_, false, {}, *workspace_).pixels, nullptr);
  slot_.format = PixelFormat::kGray16;
  slot_.bytes = slot_.bytes.first(100);
  EXPECT_EQ(stereo.convert(slot_, false, {}, *workspace_).pixels, nullptr);
  EXPECT_EQ(stereo.report().refused, 3U);
}

// Two cameras that are converted in turns with one workspace see what each of them sees alone.
TEST_P(StereoToDepthTest, CamerasShareAWorkspace) {
  StereoToDepth alone = made();
  take(0.0, false);
  const DepthImage first = alone.convert(slot_, false, {}, *workspace_);
  const std::vector<std::uint16_t> before(first.pixels, first.pixels + first.pixel_count());
  take(0.1, true);
  const DepthImage second = alone.convert(slot_, false, {}, *workspace_);
  const std::vector<std::uint16_t> after(second.pixels, second.pixels + second.pixel_count());

  StereoToDepth a = made(), b = made();
  take(0.0, false);
  a.convert(slot_, false, {}, *workspace_);
  take(0.0, true);
  b.convert(slot_, false, {}, *workspace_);
  take(0.1, true);
  const DepthImage mixed = a.convert(slot_, false, {}, *workspace_);
  EXPECT_LT(a.report().matched_share, 1.0);
  EXPECT_TRUE(std::equal(after.begin(), after.end(), mixed.pixels));
  EXPECT_NE(before, after);
}

TEST_P(StereoToDepthTest, ImagesTooDarkAreUnusableAndAskForLight) {
  StereoToDepth stereo = made();
  std::fill(pixels_.begin(), pixels_.end(), std::uint16_t{20});
  slot_.exposure = {500, 0};
  EXPECT_EQ(stereo.convert(slot_, false, {}, *workspace_).pixels, nullptr);
  EXPECT_FALSE(stereo.report().usable);
  EXPECT_EQ(stereo.report().unusable, 1U);
  EXPECT_GT(stereo.report().next.shutter_us, 1000);
  take(0.1, false);
  EXPECT_NE(stereo.convert(slot_, false, {}, *workspace_).pixels, nullptr);
  EXPECT_TRUE(stereo.report().usable);
  slot_.exposure = {};
  stereo.convert(slot_, false, {}, *workspace_);
  EXPECT_EQ(stereo.report().next.shutter_us, 0) << "a camera that cannot be told is told nothing";
}

TEST_P(StereoToDepthTest, APairThatLostItsAlignmentSaysSo) {
  StereoToDepth stereo = made();
  double now = 0;
  const auto check_once = [&] {  // a band a frame
    const int before = stereo.report().row_checks;
    for (int i = 0; i < 20 && stereo.report().row_checks == before; ++i, now += 0.11) {
      take(now, false);
      stereo.convert(slot_, false, {}, *workspace_);
    }
  };
  for (int i = 0; i < 4; ++i) check_once();
  EXPECT_EQ(stereo.report().row_checks, 4);
  EXPECT_NEAR(stereo.report().row_offset_px, 0, 0.2);
  EXPECT_FALSE(stereo.report().misaligned);
  right_.cy += 2.5;  // the right imager nods; the tables do not know
  for (int i = 0; i < 5; ++i) {
    check_once();
    EXPECT_EQ(stereo.report().misaligned, i >= 2) << i;
  }
  EXPECT_NEAR(stereo.report().row_offset_px, 2.5, 0.4);
}

// Only what a region needs is rectified: whatever else is in the workspace changes nothing.
TEST_P(StereoToDepthTest, NothingIsReadThatWasNotRectified) {
  std::mt19937 random(7);
  const auto depths_of = [&](bool with_garbage) {
    std::vector<std::uint16_t> all;
    StereoToDepth stereo = made();
    for (int i = 0; i < 6; ++i) {
      take(0.1 * i, i % 2 == 1);
      if (with_garbage)
        for (auto* image : {&workspace_->left, &workspace_->right})
          for (std::size_t k = 0; k < image->size(); ++k)
            image->data()[k] = static_cast<std::uint16_t>(random() & 0x7FFF);
      const PixelRect feedback{20 * i, 30 * i, 20 * i + 40, 30 * i + 25};
      const DepthImage depth = stereo.convert(slot_, false, {&feedback, 1}, *workspace_);
      all.insert(all.end(), depth.pixels, depth.pixels + depth.pixel_count());
      EXPECT_EQ(stereo.report().matched_share<1.0, i> 0) << i;
    }
    return all;
  };
  const auto clean = depths_of(false);
  EXPECT_TRUE(clean == depths_of(true));
}

INSTANTIATE_TEST_SUITE_P(Modes, StereoToDepthTest,
                         testing::Values(MatcherMode::kFast, MatcherMode::kAccurate),
                         [](const auto& mode_info) {
                           return mode_info.param == MatcherMode::kFast ? "fast" : "accurate";
                         });

// Odd sizes, with and without tables, 8 and 12 bits: nothing is read or written out of range (under
// the address sanitizer), and rectified images need no tables.
class OddSizes : public testing::TestWithParam<int> {};

TEST_P(OddSizes, AreConverted) {
  std::mt19937 random(static_cast<unsigned>(GetParam()));
  const auto between = [&](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
  };
  const int width = between(9, 131), height = between(7, 97);
  const Camera camera{width, height, 1.3 * width, 1.3 * width, width / 2.0, height / 2.0, {}};
  StereoRectification rectification;
  rectification.camera = camera;
  rectification.baseline = 0.1;
  if (between(0, 1) == 1)
    rectification = *make_rectification(
        camera, camera, {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.1, 0.001, 0)});
  StereoToDepthOptions options;
  options.matcher.disparity_count = 32;
  options.aligned_every_s = 0.05;
  const auto workspace = StereoWorkspace::create(width, height, options.matcher);
  ASSERT_TRUE(workspace);
  StereoToDepth stereo(std::move(rectification), options);
  FrameSlot slot;
  slot.format = between(0, 1) == 1 ? PixelFormat::kGray8 : PixelFormat::kGray16;
  slot.width = width;
  slot.height = height;
  std::vector<std::byte> bytes(2 * slot.image_bytes());
  slot.bytes = bytes;
  for (int frame = 0; frame < 4; ++frame) {
    for (std::byte& byte : bytes) byte = static_cast<std::byte>(between(0, 15));
    if (slot.format == PixelFormat::kGray8)
      for (std::byte& byte : bytes) byte = static_cast<std::byte>(between(40, 200));
    slot.instant = HostTime(from_seconds(0.1 * frame));
    const PixelRect feedback{between(0, width), between(0, height), width, height};
    const DepthImage depth = stereo.convert(slot, frame == 2, {&feedback, 1}, **workspace);
    ASSERT_NE(depth.pixels, nullptr);
    EXPECT_EQ(depth.width, width);
    EXPECT_EQ(depth.height, height);
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, OddSizes, testing::Range(0, test::cases(40, 12)));

}  // namespace
}  // namespace wagonsight
