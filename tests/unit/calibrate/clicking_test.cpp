// What the click page asks of the images: saddles, predicted boards, outlines of balls.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "calibrate/ball_centre.h"
#include "calibrate/ball_outline.h"
#include "calibrate/board_prediction.h"
#include "calibrate/corner_snap.h"
#include "geometry/transform.h"

namespace wagonsight {
namespace {

struct Picture {
  int width = 320, height = 240;
  std::vector<std::uint8_t> pixels = std::vector<std::uint8_t>(320 * 240);

  // Brightness by position, averaged over 8 x 8 points of a pixel, with noise.
  template <class Brightness>
  void paint(const Brightness& brightness, double noise = 0) {
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    for (int v = 0; v < height; ++v)
      for (int u = 0; u < width; ++u) {
        double sum = 0;
        for (int a = 0; a < 8; ++a)
          for (int b = 0; b < 8; ++b) sum += brightness(u + (a - 3.5) / 8, v + (b - 3.5) / 8) / 64;
        pixels[static_cast<std::size_t>(v * width + u)] =
            static_cast<std::uint8_t>(std::clamp(sum + noise * normal(random), 0.0, 255.0));
      }
  }
  GrayImage view() const { return {pixels.data(), width, height}; }
};

double checker(double x, double y) {
  const double c = std::cos(0.3), s = std::sin(0.3);
  const double a = c * (x - 160.37) + s * (y - 120.81), b = -s * (x - 160.37) + c * (y - 120.81);
  const bool odd =
      (static_cast<int>(std::floor(a / 22)) + static_cast<int>(std::floor(b / 22))) & 1;
  return odd ? 40 : 210;
}

TEST(CornerSnap, FindsTheSaddleToATenthOfAPixel) {
  Picture picture;
  picture.paint(checker, 2.0);
  const auto corner = snap_to_saddle(picture.view(), {162.5, 118.0}, 6);
  ASSERT_TRUE(corner);
  EXPECT_NEAR(corner->pixel.x(), 160.37, 0.1);
  EXPECT_NEAR(corner->pixel.y(), 120.81, 0.1);
  EXPECT_GT(corner->strength, 0.3);
}

TEST(CornerSnap, InventsNothingOnEdgesWallsAndAtTheBorder) {
  Picture wall, edge;
  wall.paint([](double, double) { return 128.0; }, 3.0);
  edge.paint([](double x, double) { return x < 160 ? 40.0 : 210.0; }, 2.0);
  EXPECT_FALSE(snap_to_saddle(wall.view(), {160, 120}, 6));
  EXPECT_FALSE(snap_to_saddle(edge.view(), {160, 120}, 6));
  Picture board;
  board.paint(checker);
  EXPECT_FALSE(snap_to_saddle(board.view(), {-3, 20}, 6));
  EXPECT_FALSE(snap_to_saddle(board.view(), {std::nan(""), 20}, 6));
  EXPECT_FALSE(snap_to_saddle(board.view(), {0, 0}, 2));
}

struct BoardScene {
  Board board{5, 7, 0.1};
  Camera camera;
  std::vector<Corner> corners;
  BoardScene() {
    camera.width = 640, camera.height = 480;
    camera.fx = camera.fy = 525, camera.cx = 320, camera.cy = 240;
    camera.distortion = {0.2, -0.3, 0.002, -0.001, 0};
    const Rigid X_SB{
        Eigen::Quaterniond(Eigen::AngleAxisd(0.5, Eigen::Vector3d(0.3, 0.8, 0.1).normalized())),
        {-0.3, -0.2, 1.2}};
    for (int id = 0; id < board.corner_count(); ++id)
      corners.push_back({id, *project(camera, X_SB * board.point(id))});
  }
  std::vector<Corner> only(std::initializer_list<int> ids) const {
    std::vector<Corner> some;
    for (const int id : ids) some.push_back(corners[static_cast<std::size_t>(id)]);
    return some;
  }
  double worst(const BoardPrediction& p) const {
    double most = 0;
    for (std::size_t i = 0; i < corners.size(); ++i)
      most = std::max(most, (p.corners[i].pixel - corners[i].pixel).norm());
    return most;
  }
};

TEST(BoardPrediction, AKnownCameraPlacesTheBoardFromFourCorners) {
  const BoardScene scene;
  const auto p = predict_board(scene.board, scene.only({0, 6, 28, 34}), 640, 480, scene.camera);
  ASSERT_TRUE(p);
  EXPECT_LT(scene.worst(*p), 0.05);
  EXPECT_FALSE(p->mirrored);
}

TEST(BoardPrediction, WithoutACameraItComesNearEnoughToSnapAndBetterWithMoreCorners) {
  const BoardScene scene;
  const auto four = predict_board(scene.board, scene.only({0, 6, 28, 34}), 640, 480, std::nullopt);
  const auto many = predict_board(
      scene.board, scene.only({0, 3, 6, 8, 12, 14, 17, 20, 22, 26, 28, 31, 34}), 640, 480, {});
  ASSERT_TRUE(four && many);
  EXPECT_LT(scene.worst(*four), 0.25 * spacing_at(scene.board, *four, 17));
  EXPECT_LT(scene.worst(*many), 0.5 * scene.worst(*four));
}

TEST(BoardPrediction, NamesAMirroredBoardAndTheCornerThatDoesNotFit) {
  const BoardScene scene;
  std::vector<Corner> mirrored = scene.only({0, 6, 28, 34});
  std::swap(mirrored[0].id, mirrored[1].id);
  std::swap(mirrored[2].id, mirrored[3].id);
  const auto behind = predict_board(scene.board, mirrored, 640, 480, scene.camera);
  ASSERT_TRUE(behind);
  EXPECT_TRUE(behind->mirrored);
  std::vector<Corner> wrong = scene.only({0, 3, 6, 8, 12, 14, 17, 20, 22, 28, 34});
  wrong[5].pixel += Eigen::Vector2d(14, -9);
  const auto found = predict_board(scene.board, wrong, 640, 480, scene.camera);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->misfits.front().id, 14);
}

TEST(BoardPrediction, RefusesCornersThatDoNotSpanThePlane) {
  const BoardScene scene;
  EXPECT_FALSE(predict_board(scene.board, scene.only({0, 6, 28}), 640, 480, {}));
  EXPECT_FALSE(predict_board(scene.board, scene.only({0, 1, 2, 3, 4}), 640, 480, {}));
  EXPECT_FALSE(predict_board(scene.board, scene.only({0, 1, 2, 34}), 640, 480, {}));
  EXPECT_FALSE(predict_board(scene.board, scene.only({0, 1, 2, 5, 34}), 640, 480, {}));
}

TEST(BallOutline, TakesTheCentreOfABallWithGlareOnATripod) {
  for (const double radius : {5.0, 11.0, 27.0}) {
    Picture picture;
    picture.paint(
        [&](double x, double y) {
          const double r = std::hypot(x - 150.3, y - 100.7);
          if (std::hypot(x - 147 + radius * 0.2, y - 97) < 0.25 * radius) return 250.0;  // glare
          if (r < radius) return 165 - 40 * r / radius;
          if (std::abs(x - 150.3) < 0.3 * radius && y > 100) return 150.0;  // the tripod
          return x > 200 ? 200.0 : 60.0;                                    // a window nearby
        },
        2.0);
    const auto ball =
        fit_ball_outline(picture.view(), {150.3 + 0.4 * radius, 100.7 - 0.3 * radius}, 60);
    ASSERT_TRUE(ball) << radius;
    EXPECT_NEAR(ball->centre.x(), 150.3, 0.3) << radius;
    EXPECT_NEAR(ball->centre.y(), 100.7, 0.3) << radius;
    EXPECT_NEAR(ball->semi_axes_px.mean(), radius, 0.05 * radius + 0.3);
    EXPECT_LT(ball->seen_share, 1.0);
  }
}

TEST(BallOutline, AKnownCameraTakesTheCentreOfANearBallAside) {
  Camera camera{320, 240, 260, 260, 160, 120, {0.06, -0.09, 0.0006, -0.0004, 0}};
  for (const Eigen::Vector3d& middle :
       {Eigen::Vector3d(0.36, 0.22, 0.8), Eigen::Vector3d(-0.42, -0.2, 0.9)}) {
    constexpr double kRadius = 0.1;
    Picture picture;
    picture.paint(
        [&](double x, double y) {
          const auto ray = ray_through(camera, Eigen::Vector2d(x, y));
          if (!ray) return 60.0;
          const double along = ray->normalized().dot(middle);
          return middle.squaredNorm() - along * along < kRadius * kRadius ? 190.0 : 60.0;
        },
        2.0);
    const Eigen::Vector2d truth = project(camera, middle).value();
    const auto outline = fit_ball_outline(picture.view(), truth + Eigen::Vector2d(5, -4), 60);
    ASSERT_TRUE(outline);
    const auto centre = ball_centre(camera, *outline);
    ASSERT_TRUE(centre);
    EXPECT_GT((outline->centre - truth).norm(), 0.8) << "nothing to correct";
    EXPECT_LT((centre->pixel - truth).norm(), 0.15 * (outline->centre - truth).norm());
  }
}

TEST(BallOutline, FindsNoBallWhereThereIsNone) {
  Picture wall, board;
  wall.paint([](double, double) { return 128.0; }, 2.0);
  board.paint([](double x, double) { return x < 160 ? 40.0 : 210.0; }, 2.0);
  EXPECT_FALSE(fit_ball_outline(wall.view(), {160, 120}, 40));
  EXPECT_FALSE(fit_ball_outline(board.view(), {165, 120}, 40));
  EXPECT_FALSE(fit_ball_outline(wall.view(), {-5, 1e9}, 40));
}

}  // namespace
}  // namespace wagonsight
