#include <gmock/gmock.h>

#include <cstdint>
#include <random>
#include <vector>

#include "stereo/matcher_kernels.h"
#include "support/sanitized.h"

// The kernels of this processor against the scalar specification, on random rows.

namespace wagonsight::stereo_kernels {
namespace {

using Bytes = std::vector<std::uint8_t>;

class KernelsTest : public testing::TestWithParam<int> {
 protected:
  std::mt19937 random_{static_cast<unsigned>(GetParam())};
  const Kernels& fast_ = best_kernels();
  const Kernels& slow_ = scalar_kernels();

  int between(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  Bytes bytes(std::size_t size, int most) {
    Bytes values(size);
    for (auto& value : values) value = static_cast<std::uint8_t>(between(0, most));
    return values;
  }
  int width_ = between(1, 150);
  int disparities_ = 32 * between(1, 8);
  std::size_t volume_ = static_cast<std::size_t>(width_) * static_cast<std::size_t>(disparities_);
};

TEST_P(KernelsTest, CensusRowsAreEqual) {
  const std::size_t padded = (static_cast<std::size_t>(width_) + 31) / 32 * 32;
  std::vector<std::vector<std::uint16_t>> rows(5);
  for (auto& row : rows) {
    row.resize(padded + 2 * kCensusReach);
    // Few levels, so that equal neighbours occur.
    for (auto& gray : row) gray = static_cast<std::uint16_t>(between(0, 3) * 8000 + between(0, 2));
  }
  for (const auto shape : {CensusShape::kNarrow, CensusShape::kWide})
    for (const bool mirrored : {false, true}) {
      Bytes planes[2];
      for (int k = 0; k < 2; ++k) {
        planes[k].resize(kPlaneStride * kPlanesMax);
        CensusRow row{{}, width_, shape, mirrored, planes[k].data()};
        for (std::size_t r = 0; r < 5; ++r) row.rows[r] = rows[r].data() + kCensusReach;
        (k == 0 ? slow_ : fast_).census_row(row);
        for (int p = 0; p < kPlanesMax; ++p)  // what is beyond the width is not compared
          std::fill(planes[k].begin() + p * kPlaneStride + width_,
                    planes[k].begin() + (p + 1) * kPlaneStride, std::uint8_t{0});
      }
      EXPECT_EQ(planes[0], planes[1]);
    }
}

TEST_P(KernelsTest, HammingRowsAreEqual) {
  const Bytes left = bytes(kPlaneStride * kPlanesMax, 15);
  const Bytes right = bytes(kPlaneStride * kPlanesMax, 15);
  for (const auto shape : {CensusShape::kNarrow, CensusShape::kWide}) {
    Bytes cost[2] = {Bytes(volume_), Bytes(volume_)};
    for (int k = 0; k < 2; ++k)
      (k == 0 ? slow_ : fast_)
          .hamming_row({left.data(), right.data() + width_ - 1, plane_count(shape), width_,
                        disparities_, cost[k].data()});
    EXPECT_EQ(cost[0], cost[1]);
  }
}

TEST_P(KernelsTest, BoxRowsAreEqual) {
  const Bytes above = bytes(volume_, 32), here = bytes(volume_, 32), below = bytes(volume_, 32);
  for (const bool halved : {false, true}) {
    Bytes cost[2] = {Bytes(volume_), Bytes(volume_)};
    for (int k = 0; k < 2; ++k)
      (k == 0 ? slow_ : fast_)
          .box_row({above.data(), here.data(), below.data(), width_, disparities_, halved,
                    cost[k].data()});
    EXPECT_EQ(cost[0], cost[1]);
  }
}

// All that the rows of paths and winners write.
struct Written {
  Bytes vertical, vertical_min, sum, winner, cost, below, above, right;
  bool operator==(const Written&) const = default;
};

TEST_P(KernelsTest, PathsAndWinnersAreEqual) {
  const auto width = static_cast<std::size_t>(width_);
  const int most = between(1, 255);  // small costs make ties, large ones saturate
  const Bytes cost = bytes(volume_, most), west = bytes(width + 1, 255), north = bytes(width, 255);
  const Bytes vertical = bytes(volume_, 255), vertical_min = bytes(width, 40);
  Bytes limit(256);
  const int percent = between(0, 40);
  for (int c = 0; c < 256; ++c)
    limit[static_cast<std::size_t>(c)] =
        static_cast<std::uint8_t>(percent == 0 ? 0 : std::min(255, c * 100 / (100 - percent) + 1));
  const int x_first = between(-40, 300);
  const auto penalty_1 = static_cast<std::uint8_t>(between(0, 60));

  Written written[2];
  for (int k = 0; k < 2; ++k) {
    const Kernels& kernels = k == 0 ? slow_ : fast_;
    Written& w = written[k];
    w.vertical = vertical;
    w.vertical_min = vertical_min;
    w.sum.resize(volume_);
    for (Bytes* row : {&w.winner, &w.cost, &w.below, &w.above}) row->resize(width);
    w.right.resize(width + kDisparitiesMax);
    const PathRow path{cost.data(),  west.data(),       north.data(),          penalty_1,   width_,
                       disparities_, w.vertical.data(), w.vertical_min.data(), w.sum.data()};
    const WinnerRow winners{x_first,
                            limit.data(),
                            w.winner.data(),
                            w.cost.data(),
                            w.below.data(),
                            w.above.data(),
                            w.right.data() + kDisparitiesMax};
    kernels.forward_row(path);
    if (GetParam() % 2 == 0) {
      kernels.backward_winners(path, winners);
      w.sum.clear();  // used up
    } else {
      kernels.backward_row(path);
      kernels.upward_row(path);
      kernels.upward_winners(path, winners);
    }
  }
  EXPECT_TRUE(written[0] == written[1]);
}

TEST_P(KernelsTest, MediansAreEqual) {
  const std::size_t padded = (static_cast<std::size_t>(width_) + 15) / 16 * 16 + 2;
  std::vector<std::vector<std::int16_t>> rows(3);
  for (auto& row : rows) {
    row.resize(padded);
    for (auto& d : row) d = static_cast<std::int16_t>(between(0, 3) == 0 ? -1 : between(0, 900));
  }
  std::vector<std::int16_t> out[2];
  for (int k = 0; k < 2; ++k) {
    out[k].resize(padded);
    (k == 0 ? slow_ : fast_)
        .median_row(
            {{rows[0].data() + 1, rows[1].data() + 1, rows[2].data() + 1}, width_, out[k].data()});
    out[k].resize(static_cast<std::size_t>(width_));
  }
  EXPECT_EQ(out[0], out[1]);
}

TEST_P(KernelsTest, DisparitiesAndTheirSigmasAreEqual) {
  const auto width = static_cast<std::size_t>(width_);
  const auto any_row = [&](int most) {
    Bytes row(width);
    for (auto& value : row) value = static_cast<std::uint8_t>(between(0, most));
    return row;
  };
  const Bytes winner = any_row(63), cost = any_row(255), below = any_row(255), above = any_row(255),
              seen = any_row(63), flat = any_row(1);
  std::vector<std::int16_t> out[2];
  Bytes sigma[2];
  for (int k = 0; k < 2; ++k) {
    out[k].resize(width);
    sigma[k].resize(width);
    (k == 0 ? slow_ : fast_)
        .disparity_row({winner.data(), cost.data(), below.data(), above.data(), seen.data(),
                        flat.data(), width_, 40, 5, out[k].data(), sigma[k].data()});
  }
  EXPECT_EQ(out[0], out[1]);
  EXPECT_EQ(sigma[0], sigma[1]);
  EXPECT_THAT(sigma[0], testing::Each(testing::Ge(16)));
}

INSTANTIATE_TEST_SUITE_P(Seeds, KernelsTest, testing::Range(0, test::cases(40, 6)));

// The bent equiangular fit, for every pair of rises.
TEST(Kernels, SubpixelPartsAreTheRoundedFit) {
  for (const Kernels* kernels : {&scalar_kernels(), &best_kernels()})
    for (int below = 0; below < 255; ++below) {
      Bytes winner(255, 10), cost(255, 0), down(255, static_cast<std::uint8_t>(below)), up(255);
      for (int k = 0; k < 255; ++k) up[static_cast<std::size_t>(k)] = static_cast<std::uint8_t>(k);
      const Bytes flat(255, 0);
      std::vector<std::int16_t> out(255);
      Bytes sigma(255);
      kernels->disparity_row({winner.data(), cost.data(), down.data(), up.data(), winner.data(),
                              flat.data(), 255, 0, 0, out.data(), sigma.data()});
      for (int above = 0; above < 255; ++above) {
        const double r = double(below - above) / std::max({below, above, 1});
        ASSERT_NEAR(out[static_cast<std::size_t>(above)], 640 + 64 * (0.7 * r - 0.2 * r * r * r),
                    0.501)
            << below << ", " << above;
      }
    }
}

TEST(Kernels, AFlatRowIsNotUnique) {
  // All costs equal: nothing tells the disparities apart, so there is no winner.
  const Bytes cost(32 * 8, 10), penalty(9, 40);
  Bytes vertical(32 * 8), vertical_min(8), sum(32 * 8), winner(8), least(8, 0), below(8), above(8);
  Bytes right(8 + kDisparitiesMax), limit(256);
  for (int c = 0; c < 256; ++c)
    limit[static_cast<std::size_t>(c)] = static_cast<std::uint8_t>(std::min(255, c * 11 / 10 + 1));
  const PathRow path{cost.data(), penalty.data(),  penalty.data(),      7,         8,
                     32,          vertical.data(), vertical_min.data(), sum.data()};
  for (const Kernels* kernels : {&scalar_kernels(), &best_kernels()}) {
    std::fill(vertical.begin(), vertical.end(), std::uint8_t{0});
    std::fill(vertical_min.begin(), vertical_min.end(), std::uint8_t{0});
    kernels->forward_row(path);
    kernels->backward_winners(path, {100, limit.data(), winner.data(), least.data(), below.data(),
                                     above.data(), right.data() + kDisparitiesMax});
    EXPECT_THAT(least, testing::Each(255));
  }
}

}  // namespace
}  // namespace wagonsight::stereo_kernels
