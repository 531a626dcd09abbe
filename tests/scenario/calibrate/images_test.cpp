// The commissioning tool as a person meets it: a folder of photographs and depth images of a board
// in, a solution with the depth camera's place and correction out.
#include <gmock/gmock.h>

#include "calibrate/solution.h"
#include "scenario/cli/program.h"
#include "unit/calibrate/board_images.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;

const Board kBoard{6, 9, 0.08};
const Camera kColour{640, 480, 525, 525, 319.5, 239.5, {}};
const Camera kDepth{640, 480, 575.8, 575.8, 319.5, 239.5, {}};
const Rigid kDepthInColour{Eigen::Quaterniond::Identity(), {-0.03, 0.003, 0.002}};
constexpr double kScale = 1.01, kOffset_m = -0.006;

std::string pgm8(const synthetic::Photograph& photo) {
  std::string file = fmt::format("P5\n{} {}\n255\n", photo.width, photo.height);
  file.append(photo.pixels.begin(), photo.pixels.end());
  return file;
}

// What the depth camera reads where the true depth is `z(ray)` metres, 0 for nothing: whole
// millimetres, most significant byte first.
template <class DepthAlong>
std::string pgm16(const DepthAlong& z_along) {
  std::string file = fmt::format("P5\n{} {}\n65535\n", kDepth.width, kDepth.height);
  for (int v = 0; v < kDepth.height; ++v)
    for (int u = 0; u < kDepth.width; ++u) {
      const double z =
          z_along(Eigen::Vector3d((u - kDepth.cx) / kDepth.fx, (v - kDepth.cy) / kDepth.fy, 1));
      const auto mm =
          static_cast<unsigned>(z > 0 ? std::lround(1e3 * (z - kOffset_m) / kScale) : 0);
      file.push_back(static_cast<char>(mm >> 8U));
      file.push_back(static_cast<char>(mm & 0xffU));
    }
  return file;
}

// Nothing behind the board.
std::string depth_pgm(const Rigid& X_CP) {
  const Rigid X_SP = kDepthInColour.inverse() * X_CP, X_PS = X_SP.inverse();
  const Eigen::Vector3d normal = X_SP.rotation * Eigen::Vector3d::UnitZ();
  const Eigen::Vector2d low = Eigen::Vector2d::Constant(-kBoard.square_m),
                        high = kBoard.square_m * Eigen::Vector2d(kBoard.columns, kBoard.rows);
  return pgm16([&](const Eigen::Vector3d& ray) {
    const double z = normal.dot(X_SP.position) / normal.dot(ray);
    const Eigen::Vector2d p = (X_PS * (z * ray)).head<2>();
    const bool on_board = (p.array() > low.array()).all() && (p.array() < high.array()).all();
    return on_board ? z : 0.0;
  });
}

// Balls (centres in the colour camera) before a wall.
std::string balls_pgm(const std::vector<Eigen::Vector3d>& balls_C, double radius) {
  return pgm16([&](const Eigen::Vector3d& ray) {
    double z = 3.5;
    for (const Eigen::Vector3d& ball : balls_C) {
      const Eigen::Vector3d centre = kDepthInColour.inverse() * ball;
      const double a = ray.squaredNorm(), b = ray.dot(centre);
      const double root = b * b - a * (centre.squaredNorm() - radius * radius);
      if (root > 0) z = std::min(z, (b - std::sqrt(root)) / a);
    }
    return z;
  });
}

class CalibrateImages : public testing::ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    testing::write_text(at("board.toml"), "rows = 6\ncolumns = 9\nsquare_m = 0.08\n");
    testing::write_text(at("sensors.toml"), R"([[sensor]]
name = "k0"
kind = "kinect"
width = 640
height = 480
fix_intrinsics = true
fx = 525
fy = 525
cx = 319.5
cy = 239.5
[sensor.depth]
through = "colour"
width = 640
height = 480
fx = 575.8
fy = 575.8
cx = 319.5
cy = 239.5
)");
    const double tilts[][3] = {{0.5, 0.1, 1.4},  {-0.5, 0.2, 1.8}, {0.1, 0.55, 2.2},
                               {0.2, -0.5, 1.5}, {0.4, 0.4, 2.6},  {-0.4, -0.3, 1.6}};
    for (std::size_t i = 0; i < std::size(tilts); ++i) {
      const auto [about_x, about_y, distance] = tilts[i];
      const Rigid X_CP =
          synthetic::facing(kBoard, distance, about_x, about_y, 0.1 * static_cast<double>(i));
      auto photo = synthetic::photograph(kBoard, kColour, X_CP);
      photo.blur(0.7);
      photo.expose(3, static_cast<unsigned>(i));
      testing::write_text(at(fmt::format("images/k0/{}.pgm", i)), pgm8(photo));
      testing::write_text(at(fmt::format("images/k0.depth/{}.pgm", i)), depth_pgm(X_CP));
    }
  }
};

TEST_F(CalibrateImages, GiveTheDepthCamerasPlaceAndCorrection) {
  // One image is of another size, as when the camera's mode was changed half way.
  synthetic::Photograph small;
  small.width = 320, small.height = 240;
  small.pixels.assign(320 * 240, 90);
  testing::write_text(at("images/k0/6.pgm"), pgm8(small));
  const auto detected = run("detect --images images --board board.toml --out obs.json");
  ASSERT_EQ(detected.exit_code, 0) << detected.err;
  EXPECT_THAT(detected.out, HasSubstr("k0/6.pgm: rejected: it is 320 x 240, but the sensor's first "
                                      "image is 640 x 480\n"));
  EXPECT_THAT(detected.out, HasSubstr("6 of 7 images show the board, 6 the whole of it, 0 a part "
                                      "without its place\n"));
  const auto solved = run(
      "solve --observations obs.json --sensors sensors.toml --images images --out solution.json");
  ASSERT_EQ(solved.exit_code, 0) << solved.err;
  EXPECT_THAT(solved.out, HasSubstr("in the colour camera at "));
  EXPECT_THAT(solved.out, HasSubstr("the depth says that a square is "));
  const auto solution = parse_solution(testing::read_text(at("solution.json")), "solution.json");
  ASSERT_TRUE(solution) << solution.error().message;
  ASSERT_TRUE(solution->imagers.at(0).depth);
  const DepthCalibration& depth = *solution->imagers[0].depth;
  EXPECT_EQ(depth.views, 6);
  EXPECT_LT((depth.X_CS.position - kDepthInColour.position).norm(), 0.008);
  const double z = depth.mean_depth_m;
  EXPECT_NEAR(depth.X_CS.position.z() + depth.scale * z + depth.offset_m,
              kDepthInColour.position.z() + kScale * z + kOffset_m, 0.003);
  EXPECT_EQ(run("pack --solution solution.json --out rig.blob").exit_code, 0);
}

TEST_F(CalibrateImages, OneKinectIsGeoreferencedByTheSpheresInItsDepth) {
  ASSERT_EQ(run("detect --images images --board board.toml --out obs.json").exit_code, 0);
  ASSERT_EQ(run("solve --observations obs.json --sensors sensors.toml --images images --out s.json")
                .exit_code,
            0);
  constexpr double kRadius = 0.06;
  const std::vector<Eigen::Vector3d> balls = {
      {-0.5, -0.35, 1.5}, {0.6, -0.4, 1.9}, {0.5, 0.45, 1.6}, {-0.6, 0.5, 2.2}, {0.05, 0, 2.6}};
  testing::write_text(at("images/k0.depth/balls.pgm"), balls_pgm(balls, kRadius));
  const Rigid X_WC{
      Eigen::Quaterniond(Eigen::AngleAxisd(2.1, Eigen::Vector3d(0.8, 0.5, -0.3).normalized())),
      {3.0, 1.2, 2.3}};
  // `outline`: one imager's rays do not tell how far away a ball is, the size of its outline does.
  const auto write_targets = [&](bool outline) {
    std::string list;
    for (std::size_t i = 0; i < balls.size(); ++i) {
      const Eigen::Vector3d p_W = X_WC * balls[i];
      const Eigen::Vector2d pixel = project(kColour, balls[i]).value();
      const double axis = kColour.fx * kRadius / balls[i].z();
      list += fmt::format(
          R"({}{{"id": "T{}", "world": [{}, {}, {}], "seen": [{{"sensor": "k0", "image":
             "k0/balls.pgm", "x": {}, "y": {}{}}}]}})",
          i == 0 ? "" : ", ", i, p_W.x(), p_W.y(), p_W.z(), pixel.x(), pixel.y(),
          outline ? fmt::format(", \"outline\": [{}, {}, 0]", axis, axis) : "");
    }
    testing::write_text(at("targets.json"), fmt::format("{{\"targets\": [{}]}}", list));
  };
  const std::string georeference =
      "georeference --solution s.json --targets targets.json --out geo.json";
  write_targets(true);
  const auto by_rays = run(georeference);
  EXPECT_EQ(by_rays.exit_code, 1);
  EXPECT_THAT(by_rays.err, HasSubstr("target T0: it must be seen by at least two imagers"));
  const auto no_size = run(georeference + " --images images");
  EXPECT_EQ(no_size.exit_code, 1);
  EXPECT_EQ(no_size.err,
            "target T0: a sphere in depth needs its ball's radius; give --ball-radius or its "
            "\"radius_m\"\n");
  const auto wrong_size = run(georeference + " --images images --ball-radius 0.15");
  EXPECT_EQ(wrong_size.exit_code, 1);
  EXPECT_THAT(wrong_size.out, HasSubstr("mm radius, not 150 mm"));
  const auto done = run(georeference + " --images images --ball-radius 0.06");
  ASSERT_EQ(done.exit_code, 0) << done.err << done.out;
  EXPECT_THAT(done.out, HasSubstr("target T4: a sphere in the depth of k0, "));
  const auto solution = parse_solution(testing::read_text(at("geo.json")), "geo.json");
  ASSERT_TRUE(solution) << solution.error().message;
  ASSERT_TRUE(solution->georeference);
  for (const auto& residual : solution->georeference->residuals_m)
    EXPECT_LT(residual.norm(), 0.006) << done.out;
  const Eigen::Vector3d camera_W =
      solution->georeference->X_WB * solution->imagers.at(0).X_BS.position;
  EXPECT_LT((camera_W - X_WC.position).norm(), 0.015) << done.out;
  EXPECT_NEAR(solution->georeference->X_WB.scale, 1, 0.01);
  write_targets(false);
  const auto no_outline = run(georeference + " --images images --ball-radius 0.06");
  EXPECT_EQ(no_outline.exit_code, 1);
  EXPECT_THAT(no_outline.out, HasSubstr("how far away the ball is cannot be told"));
}

TEST_F(CalibrateImages, ADepthImageOfTheWrongKindIsNamed) {
  const auto detected = run("detect --images images --board board.toml --out obs.json");
  ASSERT_EQ(detected.exit_code, 0) << detected.err;
  testing::write_text(at("images/k0.depth/2.pgm"), "P5\n2 1\n255\nab");
  const auto solved = run(
      "solve --observations obs.json --sensors sensors.toml --images images --out solution.json");
  EXPECT_EQ(solved.exit_code, 1);
  EXPECT_EQ(solved.err,
            "images/k0.depth/2.pgm: a depth image is a PNG or PGM of 16 bits, millimetres; this "
            "is another\n");
}

}  // namespace
}  // namespace wagonsight
