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

// Whole millimetres, most significant byte first; nothing behind the board.
std::string depth_pgm(const Rigid& X_CP) {
  std::string file = fmt::format("P5\n{} {}\n65535\n", kDepth.width, kDepth.height);
  const Rigid X_SP = kDepthInColour.inverse() * X_CP, X_PS = X_SP.inverse();
  const Eigen::Vector3d normal = X_SP.rotation * Eigen::Vector3d::UnitZ();
  const Eigen::Vector2d low = Eigen::Vector2d::Constant(-kBoard.square_m),
                        high = kBoard.square_m * Eigen::Vector2d(kBoard.columns, kBoard.rows);
  for (int v = 0; v < kDepth.height; ++v)
    for (int u = 0; u < kDepth.width; ++u) {
      const Eigen::Vector3d ray((u - kDepth.cx) / kDepth.fx, (v - kDepth.cy) / kDepth.fy, 1);
      const double z = normal.dot(X_SP.position) / normal.dot(ray);
      const Eigen::Vector2d p = (X_PS * (z * ray)).head<2>();
      const bool on_board = (p.array() > low.array()).all() && (p.array() < high.array()).all();
      const auto mm =
          static_cast<unsigned>(on_board ? std::lround(1e3 * (z - kOffset_m) / kScale) : 0);
      file.push_back(static_cast<char>(mm >> 8U));
      file.push_back(static_cast<char>(mm & 0xffU));
    }
  return file;
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
