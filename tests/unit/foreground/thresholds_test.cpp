#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <vector>

#include "foreground/interval_kernel.h"
#include "foreground/ray_thresholds.h"
#include "foreground/ray_walk.h"
#include "support/rendered_room.h"

namespace wagonsight {
namespace {

using testing_support::RenderedRoom;

struct Scene {
  RenderedRoom room{0.05};  // 32 x 24 pixels
  LeafGrid grid;
  SensorView view;

  explicit Scene(double leaf_m)
      : grid(*LeafGrid::cover(room.wagon.inside.min.array() - 0.3,
                              room.wagon.inside.max.array() + 0.3, leaf_m)),
        view(room.sensor, room.rays, room.wagon, grid, 3.0) {}
};

const Scene& scene() {
  static const Scene the_scene(0.05);
  return the_scene;
}

// A leaf that some pixel sees.
LeafAddress any_seen_leaf(const SensorView& view) {
  for (;;) {
    const auto pixel = *rc::gen::inRange<std::size_t>(0, view.pixel_count());
    const auto raw = *rc::gen::inRange<std::uint16_t>(500, 6000);
    const LeafAddress leaf = view.leaf_of(pixel, raw);
    if (leaf != kNoLeaf) return leaf;
  }
}

// The definition by brute force: every leaf's cube against the ray, in double precision. Depths at
// which single precision may decide otherwise (a millimetre at each end, rays that graze a cube)
// are told by `doubtful`.
Reading classify_by_hand(const Scene& s, const std::vector<LeafAddress>& leaves, std::size_t pixel,
                         std::uint16_t raw, bool& doubtful) {
  const SensorView& view = s.view;
  const Eigen::Vector3d origin = view.origin_W().cast<double>();
  const Eigen::Vector3d ray = view.ray_W(pixel).cast<double>();
  const double z = static_cast<double>(view.depth().z(raw));
  const double tolerance = static_cast<double>(view.depth().tolerance(raw));
  const Eigen::Vector3d p = origin + z * ray;
  doubtful = ((p - s.room.wagon.inside.min).array().abs() < 0.005).any() ||
             ((p - s.room.wagon.inside.max).array().abs() < 0.005).any();
  if (!s.room.wagon.inside.contains(p)) return Reading::kOutside;
  bool hit = false;
  bool beyond_all = true;
  for (const LeafAddress leaf : leaves) {
    const Eigen::Vector3d corner = s.grid.corner(s.grid.leaf_at(leaf));
    const Eigen::Array3d a = (corner - origin).array() / ray.array();
    const Eigen::Array3d b = (corner.array() + s.grid.leaf_m() - origin.array()) / ray.array();
    const double enter = a.min(b).maxCoeff(), leave = a.max(b).minCoeff();
    doubtful = doubtful || std::abs(leave - enter) < 1e-4;
    if (leave <= enter || enter < 0) continue;
    doubtful = doubtful || std::abs(z + tolerance - enter) < 0.002 ||
               std::abs(z - tolerance - leave) < 0.002;
    hit = hit || (z + tolerance >= enter && z - tolerance <= leave);
    if (z - tolerance <= leave) beyond_all = false;
  }
  if (hit) return Reading::kBackground;
  return beyond_all ? Reading::kUnknown : Reading::kForeground;
}

TEST(RayThresholds, WalkEqualsBruteForce) {
  EXPECT_TRUE(rc::check("walking the octree along a ray finds what testing every leaf finds", [] {
    const Scene& s = scene();
    BitOctree background(s.grid);
    const RayThresholds thresholds(s.view);
    std::vector<LeafAddress> leaves;
    const int count = *rc::gen::inRange(0, 400);
    for (int i = 0; i < count; ++i) {
      const LeafAddress leaf = any_seen_leaf(s.view);
      if (background.insert(leaf)) leaves.push_back(leaf);
    }
    for (int i = 0; i < 50; ++i) {
      const auto pixel = *rc::gen::inRange<std::size_t>(0, s.view.pixel_count());
      const auto raw = *rc::gen::inRange<std::uint16_t>(400, 6000);
      bool doubtful = false;
      const Reading expected = classify_by_hand(s, leaves, pixel, raw, doubtful);
      if (doubtful) continue;
      RC_ASSERT(thresholds.classify_by_octree(s.view, background, pixel, raw) == expected);
    }
  }));
}

// Leaves whose cube a ray only grazes may be in the walk and not in the cube test, or the reverse.
bool grazes(const Scene& s, const BitOctree& background, std::size_t pixel) {
  bool result = false;
  walk_ray(s.view, background, pixel, 0, 20, [&](float enter, float leave) {
    result = result || leave - enter < 1e-4F;
    return true;
  });
  return result;
}

TEST(RayThresholds, RememberedIntervalsEqualTheOctree) {
  EXPECT_TRUE(rc::check("after any leaves came and went, memory and octree agree", [] {
    const Scene& s = scene();
    BitOctree background(s.grid);
    RayThresholds thresholds(s.view);
    std::vector<LeafAddress> leaves;
    const int steps = *rc::gen::inRange(0, 300);
    for (int i = 0; i < steps; ++i) {
      if (!leaves.empty() && *rc::gen::inRange(0, 3) == 0) {
        const auto which = *rc::gen::inRange<std::size_t>(0, leaves.size());
        background.erase(leaves[which]);
        thresholds.leaf_removed(s.view, leaves[which]);
        if (*rc::gen::arbitrary<bool>()) thresholds.settle(s.view, background);
        leaves.erase(leaves.begin() + static_cast<std::ptrdiff_t>(which));
      } else {
        const LeafAddress leaf = any_seen_leaf(s.view);
        if (!background.insert(leaf)) continue;
        thresholds.leaf_added(s.view, background, leaf);
        leaves.push_back(leaf);
      }
    }
    thresholds.settle(s.view, background);
    thresholds.set_open(17);
    std::vector<std::uint16_t> image(s.view.pixel_count());
    for (auto& raw : image) {
      raw = *rc::gen::oneOf(rc::gen::just<std::uint16_t>(0),
                            rc::gen::inRange<std::uint16_t>(0, 7000));
    }
    const std::size_t words = (image.size() + 63) / 64;
    std::vector<std::uint64_t> foreground(words), unknown(words);
    thresholds.classify(s.view, background, s.room.view(image), foreground, unknown);
    for (std::size_t pixel = 0; pixel < image.size(); ++pixel) {
      const Reading expected =
          thresholds.classify_by_octree(s.view, background, pixel, image[pixel]);
      const bool is_foreground = ((foreground[pixel / 64] >> (pixel % 64)) & 1) != 0;
      const bool is_unknown = ((unknown[pixel / 64] >> (pixel % 64)) & 1) != 0;
      if (is_foreground == (expected == Reading::kForeground) &&
          is_unknown == (expected == Reading::kUnknown)) {
        continue;
      }
      RC_ASSERT(grazes(s, background, pixel));
    }
  }));
}

// The definition again: some leaf on the ray within so many times the noise of the reading.
bool is_near_by_octree(const Scene& s, const BitOctree& background, std::size_t pixel,
                       std::uint16_t raw, float reach_m) {
  const float z = s.view.depth().z(raw);
  bool found = false;
  walk_ray(s.view, background, pixel, std::max(0.0F, z - reach_m), z + reach_m,
           [&](float, float) { return !(found = true); });
  return found;
}

TEST(RayThresholds, AnUncertainReadingIsForgivenWhereBackgroundIsWithinItsNoise) {
  EXPECT_TRUE(rc::check("forgiving equals the walk with a wider noise", [] {
    const Scene& s = scene();
    BitOctree background(s.grid);
    RayThresholds thresholds(s.view);
    const int count = *rc::gen::inRange(0, 300);
    for (int i = 0; i < count; ++i) {
      const LeafAddress leaf = any_seen_leaf(s.view);
      if (background.insert(leaf)) thresholds.leaf_added(s.view, background, leaf);
    }
    std::vector<std::uint16_t> image(s.view.pixel_count());
    std::vector<std::uint8_t> noise(image.size());
    for (auto& raw : image) raw = *rc::gen::inRange<std::uint16_t>(0, 7000);
    for (auto& times : noise)
      times =
          *rc::gen::oneOf(rc::gen::just<std::uint8_t>(16), rc::gen::inRange<std::uint8_t>(0, 90));
    const std::size_t words = (image.size() + 63) / 64;
    std::vector<std::uint64_t> foreground(words), unknown(words);
    thresholds.classify(s.view, background, s.room.view(image), foreground, unknown);
    const auto bit = [](const std::vector<std::uint64_t>& bits, std::size_t pixel) {
      return ((bits[pixel / 64] >> (pixel % 64)) & 1) != 0;
    };
    const auto foreground_before = foreground, unknown_before = unknown;
    thresholds.forgive(s.view, background, s.room.view(image), noise, foreground, unknown);
    for (std::size_t pixel = 0; pixel < image.size(); ++pixel) {
      const bool before = bit(foreground_before, pixel) || bit(unknown_before, pixel);
      const bool after = bit(foreground, pixel) || bit(unknown, pixel);
      if (!before || noise[pixel] <= 16) {
        RC_ASSERT(after == before);
        continue;
      }
      // Readings are millimetres, and the tolerances at the intervals' ends are of their depths.
      constexpr float kRounding_m = 0.003F;
      const float reach =
          s.view.depth().tolerance(image[pixel]) * static_cast<float>(noise[pixel]) / 16.0F;
      const bool surely =
          is_near_by_octree(s, background, pixel, image[pixel], 0.97F * reach - kRounding_m);
      const bool maybe =
          is_near_by_octree(s, background, pixel, image[pixel], 1.03F * reach + kRounding_m);
      if (grazes(s, background, pixel)) continue;
      if (!after) RC_ASSERT(maybe);
      if (after) RC_ASSERT(!surely);
    }
  }));
}

TEST(IntervalKernel, Avx2EqualsTheScalarTwin) {
  if (!has_avx2()) GTEST_SKIP() << "this processor has no AVX2";
  EXPECT_TRUE(rc::check("the same bits on any input", [] {
    const std::size_t words = *rc::gen::inRange<std::size_t>(1, 6);
    const auto any_array = [&] {
      // Few different values, so that equalities happen; and the extremes.
      return *rc::gen::container<std::vector<std::uint16_t>>(
          words * 64, rc::gen::oneOf(rc::gen::inRange<std::uint16_t>(0, 6),
                                     rc::gen::inRange<std::uint16_t>(32765, 32771),
                                     rc::gen::inRange<std::uint16_t>(65533, 65535)));
    };
    const auto raw = any_array(), near = any_array(), first_near = any_array(),
               first_far = any_array(), second_near = any_array(), second_far = any_array();
    auto far_most = any_array(), far_least = any_array();
    for (std::size_t i = 0; i < far_most.size(); ++i) {
      if (far_least[i] > far_most[i]) std::swap(far_least[i], far_most[i]);
    }
    // The contract of RayThresholds: a pixel without a reading is never inside.
    auto near_above_zero = near;
    for (auto& value : near_above_zero) value = std::max<std::uint16_t>(value, 1);
    const IntervalArrays arrays{
        *rc::gen::element(near_above_zero.data(), static_cast<std::uint16_t*>(nullptr)),
        *rc::gen::inRange<std::uint16_t>(1, 5),
        far_most.data(),
        far_least.data(),
        first_near.data(),
        first_far.data(),
        second_near.data(),
        second_far.data()};
    std::vector<std::uint64_t> before(words), beyond(words), before2(words), beyond2(words);
    compare_intervals_scalar(raw.data(), arrays, words, before.data(), beyond.data());
    compare_intervals_avx2(raw.data(), arrays, words, before2.data(), beyond2.data());
    RC_ASSERT(before == before2);
    RC_ASSERT(beyond == beyond2);
  }));
}

TEST(DepthModel, ReadingsOfIsTheDefinitionOnMillimetres) {
  EXPECT_TRUE(rc::check("first and last reading are the outermost within tolerance", [] {
    RigSensor sensor = scene().room.sensor;
    sensor.depth_scale = *rc::gen::element(1.0, 0.997, 1.02);
    sensor.depth_offset = *rc::gen::element(0.0, 0.013);
    const DepthModel depth(sensor, 3.0);
    const float near_m = static_cast<float>(*rc::gen::inRange(300, 5900)) * 0.001F + 0.0003F;
    const float far_m = near_m + 0.02F;
    const RawInterval readings = depth.readings_of(near_m, far_m);
    for (std::uint16_t raw = depth.raw_near(); raw <= depth.raw_far(); ++raw) {
      const float low = depth.z(raw) - depth.tolerance(raw);
      const float high = depth.z(raw) + depth.tolerance(raw);
      const bool certainly = high >= near_m && low <= far_m;
      const bool possibly = high >= near_m - 0.002F && low <= far_m + 0.002F;
      const bool told = readings.first <= raw && raw <= readings.last;
      RC_ASSERT(!certainly || told);
      RC_ASSERT(possibly || !told);
    }
  }));
}

}  // namespace
}  // namespace wagonsight
