#include "stereo/tile_regions.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <random>
#include <string>
#include <vector>

namespace wagonsight {
namespace {

using Marks = std::vector<std::uint8_t>;

// '#' is marked.
Marks marks_of(const std::vector<std::string>& rows) {
  Marks marks;
  for (const std::string& row : rows)
    for (const char tile : row) marks.push_back(tile == '#' ? 1 : 0);
  return marks;
}

TEST(TileRegions, ABoxIsOneRegion) {
  Marks marks = marks_of({"......", ".####.", ".####.", "......"});
  TileRegions regions(6, 4, 0.75);
  EXPECT_THAT(regions.cover(marks), testing::ElementsAre(PixelRect{1, 1, 5, 3}));
  EXPECT_DOUBLE_EQ(regions.cost(), 5.5 * 3.5);
}

TEST(TileRegions, NothingMarkedIsNoRegion) {
  Marks marks(24, 0);
  TileRegions regions(6, 4, 0.75);
  EXPECT_TRUE(regions.cover(marks).empty());
}

// Around an L two boxes are cheaper than one; a notch is not worth another.
TEST(TileRegions, AnLIsTwoAndANotchIsFilled) {
  std::vector<std::string> wanted(20, "###.................");
  for (int row = 16; row < 20; ++row) wanted[static_cast<std::size_t>(row)] = std::string(20, '#');
  Marks marks = marks_of(wanted);
  TileRegions regions(20, 20, 0.75);
  EXPECT_THAT(regions.cover(marks),
              testing::UnorderedElementsAre(PixelRect{0, 0, 3, 16}, PixelRect{0, 16, 20, 20}));
  marks = marks_of({"####.", "#####", "#####"});
  EXPECT_THAT(TileRegions(5, 3, 0.75).cover(marks), testing::ElementsAre(PixelRect{0, 0, 5, 3}));
}

TEST(TileRegions, MorePiecesThanThereIsRoomForAreTheWholeGrid) {
  Marks marks(60 * 60, 0);
  for (std::size_t row = 0; row < 60; row += 6)
    for (std::size_t column = 0; column < 60; column += 6) marks[row * 60 + column] = 1;
  TileRegions regions(60, 60, 0.5);
  EXPECT_THAT(regions.cover(marks), testing::ElementsAre(PixelRect{0, 0, 60, 60}));
}

TEST(TileRegions, CoverAllThatIsMarkedOnceAtNoMoreThanTheCostOfOneBox) {
  std::mt19937 random(5);
  const auto between = [&](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(random);
  };
  for (int round = 0; round < 300; ++round) {
    const int columns = between(1, 40), rows = between(1, 30);
    Marks marks(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows), 0);
    const auto tile_at = [&](int x, int y) {
      return static_cast<std::size_t>(y) * static_cast<std::size_t>(columns) +
             static_cast<std::size_t>(x);
    };
    PixelRect box{columns, rows, 0, 0};
    for (int k = between(1, 6); k > 0; --k) {
      const int x0 = between(0, columns - 1), y0 = between(0, rows - 1);
      const int x1 = between(x0 + 1, columns), y1 = between(y0 + 1, rows);
      for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x) marks[tile_at(x, y)] = 1;
      box = {std::min(box.x0, x0), std::min(box.y0, y0), std::max(box.x1, x1),
             std::max(box.y1, y1)};
    }
    const Marks wanted = marks;
    TileRegions regions(columns, rows, 0.75);
    std::vector<int> covered(marks.size(), 0);
    for (const PixelRect& r : regions.cover(marks)) {
      ASSERT_TRUE(r.x0 >= 0 && r.y0 >= 0 && r.x1 <= columns && r.y1 <= rows && !r.empty());
      for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x) ++covered[tile_at(x, y)];
    }
    for (std::size_t tile = 0; tile < wanted.size(); ++tile) {
      ASSERT_LE(covered[tile], 1) << round;
      ASSERT_GE(covered[tile], wanted[tile]) << round;
    }
    EXPECT_LE(regions.cost(), (box.x1 - box.x0 + 1.5) * (box.y1 - box.y0 + 1.5) + 1e-9) << round;
  }
}

}  // namespace
}  // namespace wagonsight
