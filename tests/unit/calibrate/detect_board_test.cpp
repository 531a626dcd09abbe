#include "calibrate/detect_board.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <random>

#include "board_images.h"

namespace wagonsight {
namespace {

const Board kBoard{6, 9, 0.04};
const Camera kCamera{640, 480, 560, 560, 320, 240, {}};

struct Score {
  int corners = 0, wrong = 0;
  double rms_px = 0;
};

// Against the truth: a wrong ID is off by a square.
Score score(const DetectedBoard& detected, const Rigid& X_SP) {
  Score result;
  double sum = 0;
  for (const Corner& corner : detected.corners) {
    const Eigen::Vector2d truth = project(kCamera, X_SP * kBoard.point(corner.id)).value();
    const double error = (corner.pixel - truth).norm();
    ++result.corners;
    if (error > 2) ++result.wrong;
    sum += error * error;
  }
  result.rms_px = std::sqrt(sum / std::max(1, result.corners));
  return result;
}

// Rolled every way: the colours tell the two ends of a board with rows + columns odd apart.
TEST(DetectBoard, WholeBoardsKeepTheirIdsWhicheverWayTheyAreSeen) {
  double squares = 0;
  constexpr std::array kRolls = {0.1, 1.2, 1.9, 3.0, -2.2, -1.0};
  for (const double roll : kRolls) {
    const Rigid X_SP = synthetic::facing(kBoard, 0.7, 0.4, -0.3, roll);
    auto photo = synthetic::photograph(kBoard, kCamera, X_SP);
    photo.blur(0.7);
    photo.expose(4, 1);
    const auto detected = detect_board(photo.view(), kBoard);
    ASSERT_TRUE(detected) << detected.error().message;
    EXPECT_TRUE(detected->whole);
    const Score result = score(*detected, X_SP);
    EXPECT_EQ(result.wrong, 0) << roll;
    EXPECT_LT(result.rms_px, 0.15) << roll;
    squares += result.rms_px * result.rms_px / kRolls.size();
  }
  EXPECT_LT(std::sqrt(squares), 0.12);
}

struct Hidden {
  const char* name;
  void (*spoil)(synthetic::Photograph&);
  int corners_min;
};

class PartlyHidden : public testing::TestWithParam<Hidden> {};

TEST_P(PartlyHidden, CornersKeepTheirIds) {
  for (const double roll : {0.2, 2.9}) {
    const Rigid X_SP = synthetic::facing(kBoard, 0.7, 0.35, 0.3, roll);
    auto photo = synthetic::photograph(kBoard, kCamera, X_SP);
    GetParam().spoil(photo);
    photo.expose(4, 2);
    const auto detected = detect_board(photo.view(), kBoard);
    ASSERT_TRUE(detected) << detected.error().message;
    EXPECT_TRUE(detected->placed) << detected->why_not_placed;
    const Score result = score(*detected, X_SP);
    EXPECT_EQ(result.wrong, 0) << roll;
    EXPECT_GE(result.corners, GetParam().corners_min) << roll;
    EXPECT_LT(result.rms_px, 0.3) << roll;
  }
}

INSTANTIATE_TEST_SUITE_P(By, PartlyHidden,
                         testing::Values(Hidden{"upright_bar",
                                                [](synthetic::Photograph& p) {
                                                  p.cover(300, 0, 345, 480, 140);
                                                  p.blur(0.7);
                                                },
                                                36},
                                         Hidden{"slanting_bar",
                                                [](synthetic::Photograph& p) {
                                                  for (int v = 0; v < 480; ++v)
                                                    p.cover(150 + v / 2, v, 190 + v / 2, v + 1, 60);
                                                  p.blur(0.7);
                                                },
                                                34},
                                         Hidden{"a_person_before_one_end",
                                                [](synthetic::Photograph& p) {
                                                  p.cover(0, 0, 265, 480, 70);
                                                  p.blur(0.7);
                                                },
                                                20},
                                         Hidden{"the_lower_half_gone",
                                                [](synthetic::Photograph& p) {
                                                  p.cover(0, 262, 640, 480, 120);
                                                  p.blur(0.7);
                                                },
                                                16},
                                         Hidden{"glare",
                                                [](synthetic::Photograph& p) {
                                                  p.glare(300, 220, 70);
                                                  p.blur(0.7);
                                                },
                                                30},
                                         Hidden{"blur",
                                                [](synthetic::Photograph& p) { p.blur(3.5); }, 50},
                                         Hidden{"a_bar_and_blur",
                                                [](synthetic::Photograph& p) {
                                                  p.cover(330, 0, 370, 480, 200);
                                                  p.blur(2);
                                                },
                                                30}),
                         [](const auto& parameter) { return std::string(parameter.param.name); });

// Bars of any place, slope, width and light before boards of any roll. What is found may be little,
// or without a place, but a corner is never called by another's name: a wrong ID is worse than a
// refusal.
TEST(DetectBoard, BarsOfAnyKindGiveNoWrongId) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  const int boards = std::getenv("WAGONSIGHT_LONG_PROOF") != nullptr ? 120 : 10;
  int found = 0, placed = 0, corners = 0;
  for (int i = 0; i < boards; ++i) {
    const Rigid X_SP = synthetic::facing(kBoard, 0.7, 0.8 * (uniform(random) - 0.5),
                                         0.8 * (uniform(random) - 0.5), 6.28 * uniform(random));
    auto photo = synthetic::photograph(kBoard, kCamera, X_SP);
    const double middle = 200 + 240 * uniform(random), slope = 2 * (uniform(random) - 0.5),
                 half = 8 + 40 * uniform(random);
    const auto light = static_cast<float>(20 + 220 * uniform(random));
    for (int v = 0; v < 480; ++v) {
      const double at = middle + slope * (v - 240);
      photo.cover(static_cast<int>(at - half), v, static_cast<int>(at + half), v + 1, light);
    }
    photo.blur(0.6 + uniform(random));
    photo.expose(4, static_cast<unsigned>(i));
    const auto detected = detect_board(photo.view(), kBoard);
    if (!detected) continue;
    ++found;
    if (!detected->placed) continue;
    ++placed;
    for (const Corner& corner : detected->corners) {
      ++corners;
      const Eigen::Vector2d truth = project(kCamera, X_SP * kBoard.point(corner.id)).value();
      EXPECT_LT((corner.pixel - truth).norm(), 3) << "board " << i << ", corner " << corner.id;
    }
  }
  std::printf("bars: %d of %d boards found, %d placed, %d corners\n", found, boards, placed,
              corners);
  EXPECT_GE(placed, boards * 6 / 10);
}

TEST(DetectBoard, APartWithoutItsBorderIsNotGivenAPlaceByGuess) {
  const Rigid X_SP = synthetic::facing(kBoard, 0.7, 0.2, 0.2, 0.1);
  auto photo = synthetic::photograph(kBoard, kCamera, X_SP);
  // All but a window of some five squares each way.
  photo.cover(0, 0, 640, 155, 100);
  photo.cover(0, 325, 640, 480, 100);
  photo.cover(0, 0, 225, 480, 100);
  photo.cover(410, 0, 640, 480, 100);
  photo.blur(0.7);
  photo.expose(3, 1);
  const auto detected = detect_board(photo.view(), kBoard);
  ASSERT_TRUE(detected) << detected.error().message;
  EXPECT_GE(detected->corners.size(), 12U);
  EXPECT_FALSE(detected->placed);
  EXPECT_THAT(detected->why_not_placed,
              testing::HasSubstr("corners of a part of the board were found, but none of its "
                                 "border, so that they may be at "));
}

TEST(DetectBoard, SaysWhyThereIsNone) {
  synthetic::Photograph photo;
  photo.light.assign(640 * 480, 120);
  photo.expose(5, 1);
  const auto empty = detect_board(photo.view(), kBoard);
  ASSERT_FALSE(empty);
  EXPECT_THAT(empty.error().message, testing::StartsWith("no board was found: "));
  const Board larger{8, 13, 0.03};
  auto other = synthetic::photograph(larger, kCamera, synthetic::facing(larger, 0.7, 0.1, 0.1, 0));
  other.expose(3, 1);
  const auto wrong = detect_board(other.view(), Board{4, 5, 0.03});
  // A larger board's part is not taken for the board.
  EXPECT_TRUE(!wrong || !wrong->whole);
  const std::uint8_t few[64] = {};
  EXPECT_EQ(detect_board({few, 8, 8}, kBoard).error().message,
            "the image is too small to show a board");
}

// Real images: what is found with a rectangle blanked out must be what is found without.
TEST(DetectBoard, RealBoardsWithBlankedRectangles) {
  const std::string folder = WAGONSIGHT_SOURCE_DIR "/../shared/data/kinect_pair_boards/left";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "the recorded boards are not here";
  const Board board{7, 10, 0.03};
  int images = 0, found = 0, corners = 0, wrong = 0, unplaced = 0, expected = 0;
  double squares = 0;
  for (const char* name : {"01", "04", "07", "10", "13"}) {
    cv::Mat image = cv::imread(folder + "/" + name + ".png", cv::IMREAD_GRAYSCALE);
    ASSERT_FALSE(image.empty());
    const auto whole = detect_board({image.data, image.cols, image.rows}, board);
    if (!whole || !whole->whole) continue;
    for (const int at : {23, 36, 44}) {
      const Eigen::Vector2d middle = whole->corners[static_cast<std::size_t>(at)].pixel;
      cv::Mat spoilt = image.clone();
      const cv::Rect blank(static_cast<int>(middle.x()) - 30, static_cast<int>(middle.y()) - 22, 60,
                           44);
      spoilt(blank & cv::Rect(0, 0, image.cols, image.rows)).setTo(110);
      ++images;
      const auto part = detect_board({spoilt.data, spoilt.cols, spoilt.rows}, board);
      if (!part) continue;
      ++found;
      if (!part->placed) {
        ++unplaced;
        continue;
      }
      for (const Corner& corner : whole->corners)
        if (!blank.contains(
                cv::Point(static_cast<int>(corner.pixel.x()), static_cast<int>(corner.pixel.y()))))
          ++expected;
      for (const Corner& corner : part->corners) {
        const double error =
            (corner.pixel - whole->corners[static_cast<std::size_t>(corner.id)].pixel).norm();
        ++corners;
        if (error > 3) ++wrong;
        squares += std::min(error, 3.0) * std::min(error, 3.0);
      }
    }
  }
  std::printf("blanked: %d of %d images, %d without a place, %d of %d corners, %d wrong, %.3f px\n",
              found, images, unplaced, corners, expected, wrong,
              std::sqrt(squares / std::max(1, corners)));
  ASSERT_GE(images, 9);
  EXPECT_GE(found, images * 9 / 10);
  EXPECT_LE(wrong, corners / 100);
  EXPECT_GE(corners, expected * 8 / 10);
}

}  // namespace
}  // namespace wagonsight
