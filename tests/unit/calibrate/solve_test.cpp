#include "calibrate/solve.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "support/synthetic_rig.h"

namespace wagonsight {
namespace {

std::string told(const Solution& solution) {
  std::string text;
  for (const std::string& remark : solution.remarks) text += remark + "\n";
  return text;
}

double degrees(const Rigid& a, const Rigid& b) {
  return a.rotation.angularDistance(b.rotation) * 180 / 3.14159265358979;
}

// Mahalanobis distance squared of the pose's error under the covariance that the solution reports.
double squared_normalised_error(const Rigid& truth, const ImagerSolution& imager) {
  const Eigen::AngleAxisd turn(imager.X_BS.rotation * truth.rotation.conjugate());
  Eigen::Matrix<double, 6, 1> error;
  error << turn.angle() * turn.axis(), imager.X_BS.position - truth.position;
  return error.dot(imager.covariance.ldlt().solve(error));
}

TEST(Solve, FindsThePapersRigWithinItsNoise) {
  const auto rig = synthetic::make(1, {.noise_px = 0.25, .poses = 12});
  const auto solution = solve(rig.observations, rig.sensors);
  ASSERT_TRUE(solution) << solution.error().message;
  ASSERT_EQ(solution->imagers.size(), rig.X_BS.size());
  // B is the pose that most imagers saw; ties go to the first.
  ASSERT_EQ(solution->reference_pose, "p0");
  for (std::size_t i = 0; i < rig.X_BS.size(); ++i) {
    const ImagerSolution& imager = solution->imagers[i];
    // The Kinects' intrinsics are known; a lens that is estimated along trades its centre for a
    // turn, so those are held to their own covariance: chi-square with 6 degrees of freedom, p =
    // 1e-5.
    if (imager.kind == SensorKind::kKinect) {
      EXPECT_LT((rig.X_BS[i].position - imager.X_BS.position).norm(), 0.006) << imager.name;
      EXPECT_LT(degrees(rig.X_BS[i], imager.X_BS), 0.15) << imager.name;
    }
    EXPECT_LT(squared_normalised_error(rig.X_BS[i], imager), 33) << imager.name;
    EXPECT_NEAR(imager.rms_px_per_coordinate, 0.25, 0.03);
    EXPECT_NEAR(imager.held_out_rms_px, 0.25 * 1.414, 0.06);
  }
  EXPECT_TRUE(solution->remarks.empty()) << told(*solution);
}

TEST(Solve, NamesGrossErrorsAndIsNotMovedByThem) {
  const auto rig = synthetic::make(2, {.noise_px = 0.25, .gross_share = 0.05, .poses = 12});
  const auto solution = solve(rig.observations, rig.sensors);
  ASSERT_TRUE(solution) << solution.error().message;
  ASSERT_EQ(solution->reference_pose, "p0");
  int rejected = 0, corners = 0;
  for (std::size_t i = 0; i < rig.X_BS.size(); ++i) {
    EXPECT_LT(squared_normalised_error(rig.X_BS[i], solution->imagers[i]), 33);
    rejected += solution->imagers[i].rejected;
    corners += solution->imagers[i].corners + solution->imagers[i].rejected;
  }
  EXPECT_NEAR(static_cast<double>(rejected) / corners, 0.05, 0.01);
  EXPECT_FALSE(solution->remarks.empty());
}

TEST(Solve, ReadsMirroredAndShiftedBoardsAnyway) {
  auto rig = synthetic::make(
      3, {.noise_px = 0.2, .hidden_share = 0.0, .poses = 8, .kinects = 4, .stereos = 0});
  const Board board = rig.observations.board;
  std::string mirrored, turned;
  for (View& view : rig.observations.views) {
    if (view.image == "k1/p3.png") {
      mirrored = view.image;
      for (Corner& c : view.corners)
        c.id = c.id / board.columns * board.columns + board.columns - 1 - c.id % board.columns;
    }
    if (view.image == "k2/p4.png") {
      turned = view.image;
      for (Corner& c : view.corners) c.id = board.corner_count() - 1 - c.id;
    }
  }
  ASSERT_FALSE(mirrored.empty());
  ASSERT_FALSE(turned.empty());
  const auto solution = solve(rig.observations, rig.sensors);
  ASSERT_TRUE(solution) << solution.error().message;
  EXPECT_NE(told(*solution).find("k1/p3.png: the corner IDs are mirrored"), std::string::npos)
      << told(*solution);
  EXPECT_NE(told(*solution).find("k2/p4.png: the corner IDs are turned by 180 degrees"),
            std::string::npos)
      << told(*solution);
  for (const auto& imager : solution->imagers) EXPECT_NEAR(imager.rms_px_per_coordinate, 0.2, 0.03);
}

TEST(Solve, PlacesAPartOfABoardByTheOtherViews) {
  auto rig = synthetic::make(
      6, {.noise_px = 0.2, .hidden_share = 0.0, .poses = 8, .kinects = 4, .stereos = 0});
  const Board board = rig.observations.board;
  const std::vector<View> truth = rig.observations.views;
  // Parts of three rows and four columns, numbered as if they began at corner 0, and one of them
  // across: what a detector knows that sees no border.
  for (View& view : rig.observations.views) {
    const bool across = view.image == "k2/p4.png";
    if (view.image != "k1/p3.png" && !across) continue;
    std::vector<Corner> part;
    for (const Corner& c : view.corners) {
      const int row = c.id / board.columns - 2, column = c.id % board.columns - 4;
      if (row < 0 || row >= 3 || column < 0 || column >= 4) continue;
      part.push_back(
          {across ? (3 - column) * board.columns + row : row * board.columns + column, c.pixel});
    }
    ASSERT_EQ(part.size(), 12U);
    view.corners = part;
    view.placed = false;
  }
  const auto solution = solve(rig.observations, rig.sensors);
  ASSERT_TRUE(solution) << solution.error().message;
  for (const char* image : {"k1/p3.png", "k2/p4.png"})
    EXPECT_NE(told(*solution).find(std::string(image) +
                                   ": shows a part of the board; its place on it was found by the "
                                   "other views"),
              std::string::npos)
        << told(*solution);
  for (const ViewSolution& view : solution->views) {
    EXPECT_LT(view.rms_px, 0.5) << view.image;
    const auto original = std::find_if(truth.begin(), truth.end(),
                                       [&](const View& v) { return v.image == view.image; });
    ASSERT_NE(original, truth.end());
    for (const auto& residual : view.residuals) {
      const auto corner = std::find_if(original->corners.begin(), original->corners.end(),
                                       [&](const Corner& c) { return c.pixel == residual.pixel; });
      ASSERT_NE(corner, original->corners.end());
      EXPECT_EQ(corner->id, residual.id) << view.image;
    }
  }
}

TEST(Solve, RefusesARigThatFallsApart) {
  auto rig = synthetic::make(4, {.poses = 6, .kinects = 4, .stereos = 0});
  for (View& view : rig.observations.views)
    if (view.imager == "k2" || view.imager == "k3") view.pose += " elsewhere";
  const auto solution = solve(rig.observations, rig.sensors);
  ASSERT_FALSE(solution);
  EXPECT_EQ(
      solution.error().message,
      "the rig falls apart into [k0, k1] and [k2, k3]: photograph the board where a camera of each "
      "group sees it at once");
}

TEST(Solve, GivesTheSameOutputForTheSameInput) {
  const auto rig = synthetic::make(
      5, {.noise_px = 0.5, .gross_share = 0.02, .poses = 6, .kinects = 3, .stereos = 1});
  const auto a = solve(rig.observations, rig.sensors), b = solve(rig.observations, rig.sensors);
  ASSERT_TRUE(a) << a.error().message;
  ASSERT_TRUE(b);
  EXPECT_EQ(format_solution(*a), format_solution(*b));
}

TEST(Solve, CovarianceIsConsistentWithTheErrors) {
  // Normalised estimation error squared of imager 1 relative to the fixed board pose B = p0 over
  // seeds: its mean must be about the six degrees of freedom.
  double sum = 0;
  int count = 0;
  for (unsigned seed = 100; seed < 112; ++seed) {
    const auto rig =
        synthetic::make(seed, {.noise_px = 0.3, .poses = 6, .kinects = 3, .stereos = 0});
    const auto solution = solve(rig.observations, rig.sensors, {.hold_out = false});
    ASSERT_TRUE(solution) << solution.error().message;
    if (solution->reference_pose != "p0") continue;
    for (std::size_t i = 0; i < 3; ++i) {
      sum += squared_normalised_error(rig.X_BS[i], solution->imagers[i]);
      ++count;
    }
  }
  ASSERT_GE(count, 12);
  // Imagers of one rig share the board's error, so the interval is wider than that of independent
  // draws.
  EXPECT_GT(sum / count, 3.5);
  EXPECT_LT(sum / count, 9.0);
}

}  // namespace
}  // namespace wagonsight
