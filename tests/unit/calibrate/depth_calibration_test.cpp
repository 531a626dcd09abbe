#include "calibrate/depth_calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numeric>

#include "calibrate/pack.h"
#include "support/synthetic_rig.h"

namespace wagonsight {
namespace {

struct DepthTruth {
  Camera camera;
  Rigid X_CS;
  double scale = 1.0, offset_m = 0;
};

// What a Kinect's depth camera sees of the boards, with its noise and its steps. Only every
// ninth pixel is rendered: the others are not looked at.
std::vector<DepthView> render(const synthetic::RigWithTruth& rig, std::size_t imager,
                              const DepthTruth& truth, unsigned seed,
                              const DepthNoise& noise = {}) {
  constexpr int kStride = 9;
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const Board& board = rig.observations.board;
  std::vector<DepthView> views;
  for (std::size_t p = 0; p < rig.X_BP.size(); ++p) {
    DepthView view{rig.sensors[imager].name, "p" + std::to_string(p), "",
                   truth.camera.width,       truth.camera.height,     {}};
    view.raw_mm.assign(static_cast<std::size_t>(view.width * view.height), 0);
    const Rigid X_PS = (rig.X_BS[imager] * truth.X_CS).inverse() * rig.X_BP[p];
    const Rigid X_from = X_PS.inverse();
    const Eigen::Vector3d normal_S = X_PS.rotation * Eigen::Vector3d::UnitZ();
    for (int v = kStride / 2; v < view.height; v += kStride)
      for (int u = kStride / 2; u < view.width; u += kStride) {
        const auto ray = ray_through(truth.camera, Eigen::Vector2d(u, v));
        const double z = normal_S.dot(X_PS.position) / normal_S.dot(*ray);
        const Eigen::Vector3d p_P = X_from * (z * *ray);
        const double s = board.square_m;
        if (z < 0.5 || z > 6 || p_P.x() < -s || p_P.y() < -s || p_P.x() > s * board.columns ||
            p_P.y() > s * board.rows)
          continue;
        double raw = (z - truth.offset_m) / truth.scale;
        raw += noise.sigma(raw) * normal(random);
        // A Kinect measures whole steps of disparity, an eighth of a pixel each.
        if (noise.quantisation_per_z2 > 0)
          raw = 1 / (noise.quantisation_per_z2 * std::round(1 / (noise.quantisation_per_z2 * raw)));
        view.raw_mm[static_cast<std::size_t>(v * view.width + u)] =
            static_cast<std::uint16_t>(std::lround(raw * 1e3));
      }
    views.push_back(std::move(view));
  }
  return views;
}

synthetic::RigWithTruth two_kinects(unsigned seed) {
  return synthetic::make(
      seed, {.noise_px = 0.2, .hidden_share = 0, .poses = 24, .kinects = 2, .stereos = 0});
}

DepthTruth beside_colour() {
  DepthTruth truth;
  truth.camera = {640, 480, 575.8, 576.2, 318.2, 241.9, {}};
  truth.X_CS = {from_omega_phi_kappa({0.012, -0.02, 0.008}), {-0.028, 0.002, -0.003}};
  truth.scale = 1.012;
  truth.offset_m = -0.008;
  return truth;
}

void give_depth_camera(synthetic::RigWithTruth& rig, const DepthTruth& truth, bool infrared) {
  for (SensorSpec& spec : rig.sensors) {
    spec.depth.emplace();
    spec.depth->from_infrared = infrared;
    spec.depth->camera = truth.camera;
    spec.depth->X_CS.position = {-0.025, 0, 0};
  }
}

TEST(DepthCalibration, FindsTheTransformToColourAndTheCorrectionWithinItsCovariance) {
  const DepthTruth truth = beside_colour();
  double sum = 0;
  constexpr unsigned kSeeds = 12;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    auto rig = two_kinects(seed);
    give_depth_camera(rig, truth, false);
    auto solution = solve(rig.observations, rig.sensors, {.hold_out = false});
    ASSERT_TRUE(solution) << solution.error().message;
    const auto done = calibrate_depth(render(rig, 0, truth, seed), rig.sensors, *solution);
    ASSERT_TRUE(done) << done.error().message;
    ASSERT_TRUE(solution->imagers[0].depth);
    const DepthCalibration& depth = *solution->imagers[0].depth;
    Eigen::Matrix<double, 8, 1> error;
    const Eigen::AngleAxisd turn(depth.X_CS.rotation * truth.X_CS.rotation.conjugate());
    error << turn.angle() * turn.axis(), depth.X_CS.position - truth.X_CS.position,
        depth.scale - truth.scale, depth.offset_m - truth.offset_m;
    const Eigen::Matrix<double, 8, 8> C = depth.covariance.topLeftCorner<8, 8>();
    sum += error.dot(C.ldlt().solve(error));
    EXPECT_LT(turn.angle(), 0.02);
    EXPECT_LT((depth.X_CS.position - truth.X_CS.position).norm(), 0.015);
    // The offset and the place along the axis trade against each other, each by itself within its
    // sigma; the points that they give together must be right.
    const double z = depth.mean_depth_m;
    for (const Eigen::Vector3d& ray : {Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(0.15, 0.1, 1),
                                       Eigen::Vector3d(-0.15, -0.1, 1)}) {
      const Eigen::Vector3d found = depth.X_CS * ((depth.scale * z + depth.offset_m) * ray);
      const Eigen::Vector3d expected = truth.X_CS * ((truth.scale * z + truth.offset_m) * ray);
      EXPECT_LT(std::abs(found.z() - expected.z()), 0.004);
    }
    EXPECT_LT(std::abs(error[7] + z * error[6]),
              4 * std::sqrt(C(7, 7) + 2 * z * C(6, 7) + z * z * C(6, 6)));
  }
  // Chi-square with 96 degrees of freedom, 99.9%: 61 to 144. The corners' own planes are taken
  // without what the other views add, so the covariance may be too wide, never too narrow.
  std::printf("depth NEES %.3f of 1\n", sum / (8 * kSeeds));
  EXPECT_GT(sum / (8 * kSeeds), 0.3);
  EXPECT_LT(sum / (8 * kSeeds), 1.5);
}

// Nothing but whole millimetres and corners of a hundredth of a pixel: what is left is the
// estimator's own error.
TEST(DepthCalibration, IsExactWithoutNoise) {
  const DepthTruth truth = beside_colour();
  auto rig = synthetic::make(
      3, {.noise_px = 0.01, .hidden_share = 0, .poses = 24, .kinects = 2, .stereos = 0});
  give_depth_camera(rig, truth, false);
  auto solution = solve(rig.observations, rig.sensors, {.hold_out = false});
  ASSERT_TRUE(solution) << solution.error().message;
  const DepthNoise none{0, 0, 0, 0}, millimetre{3e-4, 0, 0, 0};
  ASSERT_TRUE(calibrate_depth(render(rig, 0, truth, 1, none), rig.sensors, *solution,
                              {.noise = millimetre}));
  const DepthCalibration& depth = solution->imagers[0].depth.value();
  EXPECT_LT(depth.X_CS.rotation.angularDistance(truth.X_CS.rotation), 2e-4);
  // A tenth of what the same images give with a Kinect's noise.
  EXPECT_LT((depth.X_CS.position - truth.X_CS.position).norm(), 1.5e-3);
  EXPECT_NEAR(depth.scale, truth.scale, 2e-4);
  EXPECT_NEAR(depth.offset_m, truth.offset_m, 1.5e-3);
  EXPECT_NEAR(depth.X_CS.position.z() + depth.offset_m + depth.scale * depth.mean_depth_m,
              truth.X_CS.position.z() + truth.offset_m + truth.scale * depth.mean_depth_m, 2e-4);
  EXPECT_LT(depth.rms_m, 4e-4);
}

TEST(DepthCalibration, FindsTheInfraredOffset) {
  double sum = 0;
  constexpr unsigned kSeeds = 12;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    auto rig = two_kinects(seed);
    DepthTruth truth;
    truth.camera = rig.cameras[1];
    truth.camera.cx -= 4.8;
    truth.camera.cy -= 3.9;
    truth.scale = 0.994;
    truth.offset_m = 0.004;
    give_depth_camera(rig, truth, true);
    auto solution = solve(rig.observations, rig.sensors, {.hold_out = false});
    ASSERT_TRUE(solution) << solution.error().message;
    const auto done = calibrate_depth(render(rig, 1, truth, seed), rig.sensors, *solution);
    ASSERT_TRUE(done) << done.error().message;
    EXPECT_FALSE(solution->imagers[0].depth) << "it has no depth image";
    ASSERT_TRUE(solution->imagers[1].depth);
    const DepthCalibration& depth = *solution->imagers[1].depth;
    const Eigen::Vector2d error = depth.pixel_offset - Eigen::Vector2d(4.8, 3.9);
    for (int k = 0; k < 2; ++k)
      EXPECT_LT(std::abs(error[k]), 4 * std::sqrt(depth.covariance(8 + k, 8 + k)));
    EXPECT_LT(error.norm(), 2.0);
    EXPECT_EQ(depth.X_CS.position.norm(), 0);
    EXPECT_NEAR(depth.camera.cx, rig.cameras[1].cx - depth.pixel_offset.x(), 1e-9);
    Eigen::Vector4d all;
    all << depth.scale - truth.scale, depth.offset_m - truth.offset_m, error;
    sum += all.dot(depth.covariance.bottomRightCorner<4, 4>().ldlt().solve(all));
  }
  // Chi-square with 48 degrees of freedom, 99.9% below 84; see above for the lower bound.
  std::printf("infrared NEES %.3f of 1\n", sum / (4 * kSeeds));
  EXPECT_GT(sum / (4 * kSeeds), 0.3);
  EXPECT_LT(sum / (4 * kSeeds), 1.75);
}

TEST(DepthCalibration, APackedSensorMeasuresInTheWorldWithItsDepthCamera) {
  const DepthTruth truth = beside_colour();
  auto rig = two_kinects(5);
  give_depth_camera(rig, truth, false);
  Solution solution = synthetic::true_solution(rig);
  solution.imagers[0].depth = DepthCalibration{};
  solution.imagers[0].depth->camera = truth.camera;
  solution.imagers[0].depth->X_CS = truth.X_CS;
  solution.imagers[0].depth->scale = truth.scale;
  solution.imagers[0].depth->offset_m = truth.offset_m;
  solution.georeference.emplace().X_WB = {1.02, from_omega_phi_kappa({3.1, 0, 1}), {1, 2, 0}};
  const auto packed = to_rig(solution);
  ASSERT_TRUE(packed) << packed.error().message;
  const RigSensor& sensor = packed->sensors[0];
  EXPECT_EQ(sensor.camera.fx, truth.camera.fx);
  // A reading becomes the same world point by the blob and by the long way over board metres.
  const double raw = 2.1;
  const Eigen::Vector3d ray = ray_through(sensor.camera, Eigen::Vector2d(100, 200)).value();
  const Eigen::Vector3d by_blob =
      sensor.X_WS * ((sensor.depth_scale * raw + sensor.depth_offset) * ray);
  const Eigen::Vector3d p_C = truth.X_CS * ((truth.scale * raw + truth.offset_m) * ray);
  const Eigen::Vector3d p_W = solution.georeference->X_WB * (rig.X_BS[0] * p_C);
  EXPECT_NEAR((by_blob - p_W).norm(), 0, 1e-9);
}

TEST(DepthCalibration, ReportsABoardOfTheWrongSize) {
  const DepthTruth truth = beside_colour();
  for (const double stated : {0.0805, 0.0832}) {
    auto rig = two_kinects(7);
    give_depth_camera(rig, truth, false);
    auto views = render(rig, 0, truth, 1), more = render(rig, 1, truth, 2);
    views.insert(views.end(), more.begin(), more.end());
    rig.observations.board.square_m = stated;
    auto solution = solve(rig.observations, rig.sensors, {.hold_out = false});
    ASSERT_TRUE(solution) << solution.error().message;
    ASSERT_TRUE(calibrate_depth(views, rig.sensors, *solution));
    ASSERT_TRUE(solution->scale_check);
    const std::string remarks =
        std::accumulate(solution->remarks.begin(), solution->remarks.end(), std::string());
    if (stated < 0.081) {
      EXPECT_TRUE(solution->scale_check->agrees);
      EXPECT_THAT(remarks, testing::Not(testing::HasSubstr("squares")));
    } else {
      // 4% too large; the units' own 0.8% (scale and offset at 2.3 m) stays in it.
      EXPECT_FALSE(solution->scale_check->agrees);
      EXPECT_NEAR(solution->scale_check->square_m, 0.08, 0.001);
      EXPECT_THAT(remarks, testing::HasSubstr("the board's squares are stated as 83.20 mm, but the "
                                              "Kinects' depth says "));
    }
  }
}

TEST(DepthCalibration, SaysWhatIsWrongWithAnImage) {
  const DepthTruth truth = beside_colour();
  auto rig = two_kinects(8);
  give_depth_camera(rig, truth, false);
  Solution solution = synthetic::true_solution(rig);
  std::vector<DepthView> views(1);
  views[0] = {"k7", "p0", "k7.depth/p0.png", 640, 480, {}};
  auto done = calibrate_depth(views, rig.sensors, solution);
  ASSERT_FALSE(done);
  EXPECT_THAT(done.error().message, testing::StartsWith("k7.depth/p0.png: \"k7\" is not in the"));
  views[0] = {"k0", "p0", "k0.depth/p0.png", 320, 240, std::vector<std::uint16_t>(320 * 240)};
  done = calibrate_depth(views, rig.sensors, solution);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().message,
            "k0.depth/p0.png: the depth image is 320 x 240, but k0's depth camera is 640 x 480");
}

TEST(DepthCalibration, SurvivesAWayThroughTheFile) {
  const DepthTruth truth = beside_colour();
  auto rig = two_kinects(9);
  give_depth_camera(rig, truth, false);
  auto solution = solve(rig.observations, rig.sensors, {.hold_out = false});
  ASSERT_TRUE(solution) << solution.error().message;
  ASSERT_TRUE(calibrate_depth(render(rig, 0, truth, 3), rig.sensors, *solution));
  const std::string text = format_solution(*solution);
  const auto back = parse_solution(text, "SOLUTION.json");
  ASSERT_TRUE(back) << back.error().message;
  ASSERT_TRUE(back->imagers[0].depth);
  // Not byte for byte: quaternions are normalised anew.
  EXPECT_EQ(back->imagers[0].depth->scale, solution->imagers[0].depth->scale);
  EXPECT_EQ(back->imagers[0].depth->covariance, solution->imagers[0].depth->covariance);
  EXPECT_EQ(back->joint_covariance, solution->joint_covariance);
  EXPECT_EQ(back->scale_check->square_m, solution->scale_check->square_m);
}

}  // namespace
}  // namespace wagonsight
