#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <map>
#include <queue>
#include <vector>

#include "foreground/blob_finder.h"
#include "support/rendered_room.h"

namespace wagonsight {
namespace {

using testing_support::RenderedRoom;

struct Scene {
  RenderedRoom room{0.05};
  LeafGrid grid = *LeafGrid::cover(room.wagon.inside.min.array() - 0.3,
                                   room.wagon.inside.max.array() + 0.3, 0.05);
  SensorView view{room.sensor, room.rays, room.wagon, grid, 3.0};
};

// Plain twin of the labelling: flood fill over neighbours that differ by little depth.
std::vector<int> flood_fill(const std::vector<std::uint16_t>& image, const std::vector<bool>& on,
                            int width, int height, const SensorView& view) {
  std::vector<int> label(image.size(), -1);
  int next = 0;
  const auto joined = [&](std::size_t a, std::size_t b) {
    // The lower or right pixel's noise decides, as in the runs.
    const std::size_t here = std::max(a, b);
    const float jump = 0.10F + view.depth().tolerance(image[here]);
    return std::abs(image[a] - image[b]) <= static_cast<int>(jump / 0.001F);
  };
  for (std::size_t start = 0; start < image.size(); ++start) {
    if (!on[start] || label[start] >= 0) continue;
    std::queue<std::size_t> todo;
    todo.push(start);
    label[start] = next;
    while (!todo.empty()) {
      const std::size_t at = todo.front();
      todo.pop();
      const int u = static_cast<int>(at) % width, v = static_cast<int>(at) / width;
      const int steps[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
      for (const auto& step : steps) {
        if (u + step[0] < 0 || u + step[0] >= width || v + step[1] < 0 || v + step[1] >= height) {
          continue;
        }
        const auto to = static_cast<std::size_t>((v + step[1]) * width + u + step[0]);
        if (!on[to] || label[to] >= 0 || !joined(at, to)) continue;
        label[to] = next;
        todo.push(to);
      }
    }
    ++next;
  }
  return label;
}

TEST(BlobFinder, KeepsTheComponentsThatFloodFillFinds) {
  static const Scene s;
  EXPECT_TRUE(rc::check("blobs are the components of enough area, pixel for pixel", [] {
    const int width = s.view.width(), height = s.view.height();
    const std::size_t pixels = s.view.pixel_count();
    std::vector<std::uint16_t> image(pixels);
    std::vector<bool> on(pixels);
    std::vector<std::uint64_t> foreground((pixels + 63) / 64), unknown(foreground.size()),
        rejected(foreground.size());
    const int density = *rc::gen::inRange(1, 10);
    for (std::size_t i = 0; i < pixels; ++i) {
      image[i] = static_cast<std::uint16_t>(*rc::gen::element(2000, 2060, 2150, 3000));
      on[i] = *rc::gen::inRange(0, 10) < density;
      foreground[i / 64] |= std::uint64_t{on[i]} << (i % 64);
    }
    // A pixel at 2 m covers 0.0048 m2 here.
    const double area_min = 0.02;
    BlobFinder finder(s.view, area_min, 0.1, 0.05, std::make_shared<BlobWorkspace>(0.05));
    Foreground out(pixels);
    finder.find(s.view, {image.data(), width, height}, foreground, unknown, rejected, out);
    const auto label = flood_fill(image, on, width, height, s.view);
    std::map<int, double> area;
    std::map<int, std::uint32_t> count;
    for (std::size_t i = 0; i < pixels; ++i) {
      if (!on[i]) continue;
      const double z = image[i] * 0.001;
      area[label[i]] += z * z * static_cast<double>(s.view.pixel_area());
      ++count[label[i]];
    }
    std::size_t kept = 0;
    for (const auto& [id, square_m] : area) kept += square_m >= area_min ? 1U : 0U;
    RC_ASSERT(out.blobs.size() == kept);
    std::uint32_t told = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      const bool in_mask = ((out.mask[i / 64] >> (i % 64)) & 1) != 0;
      const bool in_rejected = ((rejected[i / 64] >> (i % 64)) & 1) != 0;
      RC_ASSERT(in_mask == (on[i] && area[label[i]] >= area_min));
      RC_ASSERT(in_rejected == (on[i] && !in_mask));
      told += in_mask ? 1U : 0U;
    }
    std::uint32_t sum = 0;
    for (const Blob& blob : out.blobs) sum += blob.pixels;
    RC_ASSERT(sum == told);
  }));
}

TEST(BlobFinder, KeepsUnknownPixelsOnlyWithForeground) {
  const Scene s;
  const int width = s.view.width(), height = s.view.height();
  std::vector<std::uint16_t> image(s.view.pixel_count(), 2500);
  std::vector<std::uint64_t> foreground((image.size() + 63) / 64), unknown(foreground.size()),
      rejected(foreground.size());
  const auto set = [&](std::vector<std::uint64_t>& bits, int u, int v) {
    const auto pixel = static_cast<std::size_t>(v * width + u);
    bits[pixel / 64] |= std::uint64_t{1} << (pixel % 64);
  };
  for (int v = 2; v < 10; ++v) {
    for (int u = 2; u < 6; ++u) set(u < 4 ? foreground : unknown, u, v);  // half and half
    for (int u = 12; u < 16; ++u) set(unknown, u, v);                     // nothing but unknown
  }
  BlobFinder finder(s.view, 0.01, 0.1, 0.05, std::make_shared<BlobWorkspace>(0.05));
  Foreground out(image.size());
  finder.find(s.view, {image.data(), width, height}, foreground, unknown, rejected, out);
  ASSERT_EQ(out.blobs.size(), 1U);
  EXPECT_EQ(out.blobs[0].pixels, 32U);
  EXPECT_EQ(out.blobs[0].u_min, 2);
  EXPECT_EQ(out.blobs[0].u_max, 5);
  EXPECT_EQ(out.blobs[0].v_max, 9);
  EXPECT_NEAR(out.blobs[0].depth_mean, 2.5F, 1e-4F);
}

}  // namespace
}  // namespace wagonsight
