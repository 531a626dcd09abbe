#include "simulate/stereo_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "counted_heap.h"
#include "simulate/room.h"
#include "simulate/simulation.h"
#include "stereo/alignment.h"
#include "stereo/exposure.h"
#include "stereo/matcher.h"
#include "stereo/rectify.h"

namespace wagonsight {
namespace {

constexpr int kWidth = 769, kHeight = 448;
constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;

constexpr std::string_view kRoom = R"(
[wagon]
length = 6.0
width = 2.7
height = 2.4
[[seat]]
name = "s1"
position = [4.75, 0.35]
yaw = 90
width = 0.48
[[window]]
min = [2.0, 2.69, 1.25]
max = [4.0, 2.75, 1.95]
[[screen]]
name = "map"
min = [5.95, 1.0, 1.2]
max = [6.0, 1.7, 1.6]
[[sensor]]
name = "s0"
kind = "stereo"
position = [1.2, 0.3, 2.2]
look_at = [4.0, 2.2, 0.8]
noise = 0
[[passenger]]
name = "stands"
height = 1.75
start = [3.2, 1.4]
)";

Scene scene_with(std::string_view more = "") {
  auto scene = parse_scene(std::string(kRoom) + std::string(more), "test");
  EXPECT_TRUE(scene) << scene.error().message;
  return *scene;
}

HostTime at(double seconds) {
  return HostTime(from_seconds(seconds));
}

struct Pair {
  std::vector<std::uint16_t> raw = std::vector<std::uint16_t>(2 * kPixels);
  std::vector<std::uint16_t> left = std::vector<std::uint16_t>(kPixels), right = left;

  void rectify_by(const StereoGeometry& imagers) {
    const auto tables = make_rectification(imagers.left, imagers.right, imagers.X_LR);
    ASSERT_TRUE(tables);
    rectify({raw.data(), PixelFormat::kGray16, kWidth, kHeight}, tables->left, left.data());
    rectify({raw.data() + kPixels, PixelFormat::kGray16, kWidth, kHeight}, tables->right,
            right.data());
  }
};

double mean_of(std::span<const std::uint16_t> pixels) {
  return std::accumulate(pixels.begin(), pixels.end(), 0.0) / static_cast<double>(pixels.size());
}

// What a surface looks like is the same from both imagers, where the truth says that it is.
TEST(StereoModel, TheTrueDisparityCarriesTheLeftImageIntoTheRightOne) {
  const Scene scene = scene_with();
  World world(scene, 1);
  StereoModel model(scene, 0, 1);
  Pair pair;
  model.render(world, at(1), 1, StereoModel::kFirstExposure, pair.raw);
  pair.rectify_by(model.imagers());
  std::vector<float> w(kPixels);
  model.truth(world, at(1), w);
  const double fb = model.rectified().camera.fx * model.rectified().baseline;
  const auto difference = [&](double shift) {
    double sum = 0;
    int count = 0;
    for (int v = 20; v < kHeight - 20; ++v)
      for (int u = 90; u < kWidth - 20; ++u) {
        const std::size_t pixel = static_cast<std::size_t>(v * kWidth + u);
        // Where the surface goes on smoothly to both sides: no edge is hidden from one imager.
        if (w[pixel] <= 0 || std::abs(w[pixel - 6] + w[pixel + 6] - 2 * w[pixel]) > 2e-4F) continue;
        const double x = u - fb * static_cast<double>(w[pixel]) + shift;
        const auto left = static_cast<std::size_t>(v * kWidth) + static_cast<std::size_t>(x);
        const double f = x - std::floor(x);
        const double seen = (1 - f) * pair.right[left] + f * pair.right[left + 1];
        sum += std::abs(seen - pair.left[pixel]) / (100.0 + pair.left[pixel]);
        ++count;
      }
    EXPECT_GT(count, 50'000);
    return sum / count;
  };
  const double exact = difference(0);
  EXPECT_LT(exact, 0.04);
  EXPECT_GT(difference(1), 1.2 * exact);
  EXPECT_GT(difference(-1), 1.2 * exact);
  EXPECT_GT(difference(4), 1.5 * exact);
}

TEST(StereoModel, TheMatcherFindsTheTruthWhereThereIsTexture) {
  Scene scene = scene_with();
  scene.sensors[0].noise = 1;
  World world(scene, 1);
  StereoModel model(scene, 0, 1);
  Pair pair;
  model.render(world, at(1), 1, StereoModel::kFirstExposure, pair.raw);
  pair.rectify_by(model.imagers());
  std::vector<float> w(kPixels);
  std::vector<std::int32_t> tags(kPixels);
  model.truth(world, at(1), w, tags);
  auto matcher = StereoMatcher::create(kWidth, kHeight, {});
  ASSERT_TRUE(matcher);
  std::vector<std::int16_t> disparity(kPixels);
  matcher->match({pair.left.data(), PixelFormat::kGray16, kWidth, kHeight},
                 {pair.right.data(), PixelFormat::kGray16, kWidth, kHeight},
                 {disparity.data(), kWidth, kHeight});
  const double fb = model.rectified().camera.fx * model.rectified().baseline;
  int matched = 0, bad = 0, of_person = 0, of_person_matched = 0;
  for (std::size_t i = 0; i < kPixels; ++i) {
    if (tags[i] > 0) ++of_person;
    if (disparity[i] < 0 || w[i] <= 0) continue;
    ++matched;
    if (tags[i] > 0) ++of_person_matched;
    bad += std::abs(disparity[i] / 64.0 - fb * static_cast<double>(w[i])) > 1;
  }
  EXPECT_GT(matched, static_cast<int>(kPixels / 3));
  EXPECT_LT(bad, matched / 12);
  EXPECT_GT(of_person, 5'000);
  EXPECT_GT(of_person_matched, of_person / 2);
}

TEST(StereoModel, TheSameBytesEveryTimeAndOtherNoiseInEveryFrame) {
  Scene scene = scene_with();
  scene.sensors[0].noise = 1;
  std::vector<std::uint16_t> a(2 * kPixels), b = a, c = a;
  for (auto* pair : {&a, &b}) {
    World world(scene, 3);
    StereoModel model(scene, 0, 3);
    model.render(world, at(0.5), 7, StereoModel::kFirstExposure, *pair);
    if (pair == &b) model.render(world, at(0.5), 8, StereoModel::kFirstExposure, c);
  }
  EXPECT_EQ(a, b);
  EXPECT_NE(a, c);
}

TEST(StereoModel, ATunnelIsDarkAndTheExposureLawBringsTheLightBack) {
  const Scene scene = scene_with(R"(
[[light]]
at = 1
state = "tunnel"
[[light]]
at = 4
state = "day"
)");
  SimulatedDevice device(scene, 0, 1);
  std::vector<std::byte> bytes(device.slot_bytes());
  FrameSlot slot;
  slot.bytes = bytes;
  double before = 0, first_in_tunnel = 0, adapted = 0, brightest_outside = 0, again = 0;
  while (device.upcoming().instant < at(6)) {
    const double time = to_seconds(device.upcoming().instant.time_since_epoch());
    device.next(slot);
    ASSERT_EQ(slot.format, PixelFormat::kGray16);
    const GrayImage left{slot.bytes.data(), slot.format, slot.width, slot.height};
    const auto seen = measure_exposure(left, {}, StereoModel::kFullScale);
    const auto next = next_exposure(seen, {static_cast<double>(slot.exposure.shutter_us),
                                           static_cast<double>(slot.exposure.gain_db)})
                          .next;
    device.set_exposure({static_cast<float>(next.shutter_us), static_cast<float>(next.gain_db)});
    if (time < 1) before = seen.mean;
    if (time > 1.2 && first_in_tunnel == 0) first_in_tunnel = seen.mean;
    if (time < 4) adapted = seen.mean;
    if (time > 4 && time < 5) brightest_outside = std::max(brightest_outside, seen.mean);
    again = seen.mean;
  }
  EXPECT_NEAR(before, 0.3, 0.1);
  EXPECT_LT(first_in_tunnel, 0.85 * before);
  EXPECT_NEAR(adapted, 0.35, 0.08);
  EXPECT_GT(brightest_outside, 1.1 * adapted);
  EXPECT_NEAR(again, before, 0.06);
}

TEST(StereoModel, SunPatchesMoveAndAScreenRuns) {
  const Scene scene = scene_with(R"(
[[light]]
at = 0
state = "sun"
direction = [0.1, -0.8, -0.6]
)");
  Scene day = scene;
  day.lights.clear();
  World world(scene, 1), day_world(day, 1);
  StereoModel sunny(scene, 0, 1), plain(day, 0, 1);
  std::vector<std::uint16_t> a(2 * kPixels), b = a, c = a;
  const Exposure exposure{500, 0};
  sunny.render(world, at(1), 1, exposure, a);
  sunny.render(world, at(9), 1, exposure, b);
  plain.render(day_world, at(1), 1, exposure, c);
  int bright = 0, moved = 0;
  for (std::size_t i = 0; i < kPixels; ++i) {
    bright += a[i] > 2 * c[i] + 100;
    moved += std::abs(a[i] - b[i]) > 200;
  }
  EXPECT_GT(bright, 2'000);
  EXPECT_LT(bright, static_cast<int>(kPixels / 3));
  EXPECT_GT(moved, 1'000);
  EXPECT_GT(mean_of({a.data(), kPixels}), mean_of({c.data(), kPixels}));
}

TEST(StereoModel, ABentCameraHasItsRowsApart) {
  const Scene scene = scene_with(R"(
[[fault]]
at = 2
sensor = "s0"
kind = "bent"
amount = 2
)");
  World world(scene, 1);
  StereoModel model(scene, 0, 1);
  AlignmentCheck check(kWidth, kHeight);
  Pair pair;
  const auto rows = [&](double seconds) {
    model.render(world, at(seconds), 1, StereoModel::kFirstExposure, pair.raw);
    pair.rectify_by(model.imagers());
    return check.measure({pair.left.data(), PixelFormat::kGray16, kWidth, kHeight},
                         {pair.right.data(), PixelFormat::kGray16, kWidth, kHeight});
  };
  const RowAlignment straight = rows(1), bent = rows(3);
  EXPECT_TRUE(straight.reliable);
  EXPECT_NEAR(straight.median_offset_px, 0, 0.15);
  EXPECT_TRUE(bent.reliable);
  EXPECT_NEAR(std::abs(bent.median_offset_px), 2, 0.3);
}

TEST(StereoModel, RenderingAllocatesNothing) {
  const Scene scene = scene_with("[[light]]\nat = 1\nstate = \"tunnel\"\n");
  World world(scene, 1);
  StereoModel model(scene, 0, 1);
  std::vector<std::uint16_t> pair(2 * kPixels);
  if (!allocations_are_counted()) GTEST_SKIP() << "a sanitizer owns the heap";
  const std::size_t before = allocation_count();
  model.render(world, at(0.1), 1, StereoModel::kFirstExposure, pair);
  model.render(world, at(3), 2, StereoModel::kFirstExposure, pair);
  EXPECT_EQ(allocation_count(), before);
}

}  // namespace
}  // namespace wagonsight
