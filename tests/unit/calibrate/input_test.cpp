#include <gtest/gtest.h>

#include "calibrate/imagers.h"
#include "calibrate/observations.h"

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
            "SENSORS.toml:4: widht is not a key of a sensor"}));

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
