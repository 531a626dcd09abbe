#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <limits>

#include "calibrate/imagers.h"
#include "calibrate/observations.h"
#include "support/synthetic_rig.h"

namespace wagonsight {
namespace {

struct Bad {
  const char* text;
  const char* message;
};

class BadObservations : public testing::TestWithParam<Bad> {};

TEST_P(BadObservations, AreNamed) {
  const auto parsed = parse_observations(GetParam().text, "OBS.json");
  ASSERT_FALSE(parsed);
  EXPECT_EQ(parsed.error().message, GetParam().message);
}

INSTANTIATE_TEST_SUITE_P(
    Table, BadObservations,
    testing::Values(
        Bad{"[", "OBS.json: this is not JSON"},
        Bad{R"({"views":[]})", "OBS.json: \"board\" with rows, columns and square_m is missing"},
        Bad{R"({"board":{"rows":1,"columns":9,"square_m":0.08},"views":[]})",
            "OBS.json: board.rows = 1 must lie between 2 and 200"},
        Bad{R"({"board":{"rows":6,"columns":9,"square_m":0.08},"views":[]})",
            "OBS.json: \"views\" is missing or empty"},
        Bad{R"({"board":{"rows":6,"columns":9,"square_m":0.08},"views":[{"sensor":"k0","corners":[]}]})",
            "OBS.json: view 0 (k0): it has no corners; remove the view or click its corners"},
        Bad{R"({"board":{"rows":6,"columns":9,"square_m":0.08},"views":[{"sensor":"k0","corners":[{"id":54,"x":1,"y":2}]}]})",
            "OBS.json: view 0 (k0): corner 54 is not on the board (0 to 53)"},
        Bad{R"({"board":{"rows":6,"columns":9,"square_m":0.08},"views":[{"sensor":"k0","corners":[{"id":5,"x":1,"y":2},{"id":5,"x":1,"y":2}]}]})",
            "OBS.json: view 0 (k0): corner 5 stands there twice"},
        Bad{R"({"board":{"rows":6,"columns":9,"square_m":0.08},"views":[{"sensor":"k0","corners":[{"id":5,"x":null,"y":2}]}]})",
            "OBS.json: view 0 (k0): corner 5 has no finite \"x\""}));

class BadSensors : public testing::TestWithParam<Bad> {};

TEST_P(BadSensors, AreNamed) {
  const auto parsed = parse_sensors(GetParam().text, "SENSORS.toml");
  ASSERT_FALSE(parsed);
  EXPECT_EQ(parsed.error().message, GetParam().message);
}

INSTANTIATE_TEST_SUITE_P(
    Table, BadSensors,
    testing::Values(
        Bad{"", "SENSORS.toml: no [[sensor]] is described"},
        Bad{"[[sensor]]\nname = \"k0\"\nkind = \"lidar\"\nwidth = 640\nheight = 480\n",
            "SENSORS.toml:1: sensor k0: kind = \"lidar\" must be \"kinect\" or \"stereo\""},
        Bad{"[[sensor]]\nname = \"k0\"\nkind = \"kinect\"\nwidth = 640\n",
            "SENSORS.toml:1: height is missing"},
        Bad{"[[sensor]]\nname = \"k0\"\nkind = \"kinect\"\nwidth = 640\nheight = "
            "480\nfix_intrinsics = true\n",
            "SENSORS.toml:1: sensor k0 has fix_intrinsics but no fx, fy, cx, cy to keep"},
        Bad{"[[sensor]]\nname = \"k0\"\nkind = \"kinect\"\nwidht = 640\n",
            "SENSORS.toml:4: widht is not a key of a sensor"},
        Bad{"[[sensor]]\nname = \"s0\"\nkind = \"stereo\"\nwidth = 640\nheight = "
            "480\n[sensor.depth]\nthrough = \"colour\"\n",
            "SENSORS.toml:1: sensor s0: [sensor.depth] describes the depth camera of a kinect"},
        Bad{"[[sensor]]\nname = \"k0\"\nkind = \"kinect\"\nwidth = 640\nheight = "
            "480\n[sensor.depth]\nthrough = \"radar\"\n",
            "SENSORS.toml:6: sensor k0: through = \"radar\" must name the image that is "
            "calibrated, "
            "\"colour\" or \"infrared\""},
        Bad{"[[sensor]]\nname = \"k0\"\nkind = \"kinect\"\nwidth = 640\nheight = "
            "480\n[sensor.depth]\nthrough = \"infrared\"\nheigth = 3\n",
            "SENSORS.toml:8: heigth is not a key of a depth camera"}));

// What only the solver can see: observations that are well formed and do not fit the sensors.
class BadProblem : public testing::Test {
 protected:
  BadProblem()
      : rig_(synthetic::make(3, {.hidden_share = 0, .poses = 4, .kinects = 2, .stereos = 0})) {}
  std::string refusal() const {
    const auto solution = solve(rig_.observations, rig_.sensors, {.hold_out = false});
    return solution ? "solved" : solution.error().message;
  }
  View& view() { return rig_.observations.views.at(1); }
  synthetic::RigWithTruth rig_;
};

TEST_F(BadProblem, UnknownSensor) {
  view().imager = "k9";
  EXPECT_EQ(refusal(),
            "the view k1/p0.png is of \"k9\", which no sensor is called; describe it or remove its "
            "views");
}

TEST_F(BadProblem, MixedImageSizes) {
  rig_.sensors[1].width = 320;
  rig_.sensors[1].height = 240;
  EXPECT_THAT(refusal(), testing::MatchesRegex("k1 k1/p0.png: corner [0-9]+ at .* lies outside of "
                                               "the 320 x 240 image; is the size in the sensors' "
                                               "file right\\?"));
}

TEST_F(BadProblem, NotANumber) {
  view().corners[0].pixel.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(refusal(), testing::HasSubstr("k1/p0.png: corner 0 at (nan, "));
}

TEST_F(BadProblem, DuplicateIds) {
  view().corners[1].id = view().corners[0].id;
  EXPECT_EQ(refusal(), "k1 k1/p0.png: corner 0 stands there twice");
  view().corners[1].id = 54;
  EXPECT_EQ(refusal(), "k1 k1/p0.png: corner 54 is not on the board (0 to 53)");
}

TEST_F(BadProblem, EmptyViewsAreLeftOutAndNamed) {
  view().corners.clear();
  const auto solution = solve(rig_.observations, rig_.sensors, {.hold_out = false});
  ASSERT_TRUE(solution) << solution.error().message;
  EXPECT_THAT(solution->remarks, testing::Contains("k1 k1/p0.png: it has no corners; the view was "
                                                   "left out"));
}

TEST_F(BadProblem, NothingAtAll) {
  rig_.observations.views.clear();
  EXPECT_EQ(refusal(), "k0 has no view; photograph the board with it or leave it out");
}

TEST_F(BadProblem, TooManyViews) {
  view().corners.resize(1);
  rig_.observations.views.assign(20'001, View(view()));
  EXPECT_EQ(parse_observations(format_observations(rig_.observations), "OBS.json").error().message,
            "OBS.json: 20001 views are more than the 20000 that can be solved at once");
}

// Ten thousand views are many, not wrong: the start values' vote and the covariances must not grow
// with their square. The long form (WAGONSIGHT_LONG_PROOF=1) solves them, the short one a few
// hundred.
TEST(ManyViews, AreSolved) {
  const int poses = std::getenv("WAGONSIGHT_LONG_PROOF") != nullptr ? 5000 : 200;
  auto rig = synthetic::make(5, {.hidden_share = 0.7, .poses = poses, .kinects = 2, .stereos = 0});
  ASSERT_GT(rig.observations.views.size(), static_cast<std::size_t>(poses) * 3 / 2);
  const auto solution = solve(rig.observations, rig.sensors);
  ASSERT_TRUE(solution) << solution.error().message;
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_LT((solution->imagers[i].X_BS.position - rig.X_BS[i].position).norm(), 0.01);
    EXPECT_NEAR(solution->imagers[i].rms_px_per_coordinate, 0.25, 0.03);
  }
}

TEST(Observations, RoundTrip) {
  Observations observations;
  observations.board = {6, 9, 0.08};
  observations.views.push_back({"k0", "k0/1.png", "1", {{17, {10.25, 20.5}}, {3, {1, 2}}}});
  const auto back = parse_observations(format_observations(observations), "OBS.json");
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(format_observations(*back), format_observations(observations));
}

}  // namespace
}  // namespace wagonsight
