#include "settings/settings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <numbers>
#include <sstream>

namespace wagonsight {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

Settings read(std::string_view text) {
  const auto settings = parse_settings(text, "unit.toml");
  EXPECT_TRUE(settings) << settings.error().message;
  return settings ? *settings : Settings{};
}

std::string mistakes_of(std::string_view text) {
  const auto settings = parse_settings(text, "unit.toml");
  return settings ? "none" : settings.error().message;
}

std::string file_text(const std::string& path) {
  std::ifstream file(std::string(WAGONSIGHT_SOURCE_DIR) + "/" + path);
  EXPECT_TRUE(file) << path;
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

TEST(Settings, HaveDefaultsForEverything) {
  const Settings settings = read("");
  EXPECT_DOUBLE_EQ(settings.pipeline.leaf_m, 0.02);
  EXPECT_EQ(settings.web.host, "127.0.0.1");
  EXPECT_FALSE(settings.wagon);
  EXPECT_TRUE(settings.sensors.empty());
}

TEST(Settings, OfTheReferenceFileAreReadWhole) {
  const auto settings = parse_settings(file_text("config/wagonsight.toml"), "/etc/w/unit.toml");
  ASSERT_TRUE(settings) << settings.error().message;
  EXPECT_EQ(settings->unit.name, "wagon 4711");
  ASSERT_TRUE(settings->wagon);
  EXPECT_EQ(settings->wagon->inside.max, Eigen::Vector3d(6.0, 2.7, 2.4));
  EXPECT_EQ(settings->wagon->zones.size(), 2U);
  EXPECT_EQ(settings->wagon->zones[0].capacity, 12);
  EXPECT_EQ(settings->wagon->zones[1].capacity, 0);
  EXPECT_EQ(settings->wagon->seats.size(), 1U);
  EXPECT_EQ(settings->wagon->doors[0].to, (std::array<double, 2>{5.8, 0.0}));
  EXPECT_EQ(settings->wagon->masks.size(), 3U);
  ASSERT_EQ(settings->sensors.size(), 2U);
  EXPECT_EQ(settings->sensors[0].file, "/etc/w/journey.mcap");
  EXPECT_EQ(settings->sensors[0].trim_m, (std::array<double, 2>{0.5, 5.5}));
  EXPECT_FALSE(settings->sensors[1].trim_m);
  EXPECT_EQ(settings->rig.blob, "/etc/w/rig.blob");
  EXPECT_EQ(settings->web.port, 8080);
}

TEST(Settings, OfTheDemoNameAScene) {
  const auto settings = parse_settings(file_text("config/demo.toml"), "config/demo.toml");
  ASSERT_TRUE(settings) << settings.error().message;
  EXPECT_EQ(settings->demo.scene, "config/scenes/demo.toml");
  EXPECT_TRUE(settings->web.on_loopback());
}

TEST(Settings, TurnDegreesIntoRadians) {
  const Settings settings = read(R"([wagon]
length = 6
width = 3
height = 2
[[seat]]
name = "1"
position = [1, 1]
yaw = 90)");
  ASSERT_TRUE(settings.wagon);
  EXPECT_DOUBLE_EQ(settings.wagon->seats[0].yaw, std::numbers::pi / 2);
}

TEST(Settings, TakeAnInsideThatIsNotAtTheOrigin) {
  const Settings settings = read("[wagon]\ninside = {min = [-1, -2, -0.1], max = [5, 2, 2.4]}");
  ASSERT_TRUE(settings.wagon);
  EXPECT_EQ(settings.wagon->inside.min, Eigen::Vector3d(-1, -2, -0.1));
}

TEST(Settings, LeaveAbsolutePathsAlone) {
  EXPECT_EQ(read("[rig]\nblob = \"/a/b\"").rig.blob, "/a/b");
  EXPECT_EQ(read("[rig]\nblob = \"b\"").rig.blob, "b");
}

TEST(Settings, ReportEveryMistakeInTheOrderOfTheLines) {
  EXPECT_EQ(mistakes_of("[web]\nport = 70000\n[pipeline]\nleaf_m = 2\nleef_m = 1\n"),
            "unit.toml:2: web.port = 70000: must be a whole number from 0 to 65535\n"
            "unit.toml:4: pipeline.leaf_m = 2: must be from 0.01 to 0.1\n"
            "unit.toml:5: pipeline.leef_m: unknown key; did you mean leaf_m?");
}

TEST(Settings, ThermalBandsRiseAndTheirRatesFall) {
  const Settings settings = read("[thermal]\nwarm_c = 70\nhot_c = 85\nwarm_hz = 10\nhot_hz = 2\n");
  EXPECT_EQ(settings.thermal.warm_c, 70);
  EXPECT_EQ(settings.thermal.hot_hz, 2);
  EXPECT_EQ(read("").thermal.folder, "/sys/class/thermal");
  EXPECT_THAT(mistakes_of("[thermal]\nwarm_c = 90\nhot_c = 80\n"), HasSubstr("above warm_c"));
  EXPECT_THAT(mistakes_of("[thermal]\nhot_hz = 20\n"), HasSubstr("not be above warm_hz"));
}

TEST(Settings, NeverShowASecret) {
  constexpr std::string_view kText = R"([web.tokens]
read = "short-secret"
admin = "long enough, but with spaces"
[unit]
nmae = "x")";
  const std::string mistakes = mistakes_of(kText);
  EXPECT_THAT(mistakes, HasSubstr("unit.toml:2: web.tokens.read: must be"));
  EXPECT_THAT(mistakes, Not(HasSubstr("secret\"")));
  EXPECT_THAT(mistakes, Not(HasSubstr("long enough")));
}

TEST(Settings, AreToldWithoutSecrets) {
  constexpr std::string_view kText = R"([unit]
name = "w"
[web]
port = 81
[web.tokens]
read = "0123456789abcdef0"
admin = ["0123456789abcdef1"]
)";
  const std::string told = without_secrets(kText);
  EXPECT_THAT(told, HasSubstr("port = 81"));
  EXPECT_THAT(told, HasSubstr("read = \"(removed)\""));
  EXPECT_THAT(told, Not(HasSubstr("0123456789abcdef")));
  EXPECT_THAT(without_secrets("[web]\ntokens = \"0123\""), Not(HasSubstr("0123")));
  EXPECT_EQ(without_secrets("[web"), "");
}

// What is told reads back as the same settings.
TEST(Settings, SurviveBeingTold) {
  const std::string told = without_secrets(file_text("config/wagonsight.toml"));
  const Settings settings = read(told);
  EXPECT_EQ(settings.unit.name, "wagon 4711");
  EXPECT_EQ(settings.wagon->masks.size(), 3U);
  EXPECT_EQ(settings.wagon->masks[1].bounds.max.z(), 1.8);
  EXPECT_EQ(without_secrets(told), told);
  const std::string odd = "'a b' = \"\\\"\\\\\\n\"\n";
  EXPECT_EQ(without_secrets(odd), "\"a b\" = \"\\\"\\\\\\u000A\"\n");
}

struct BadSettings {
  const char* what;
  const char* text;
  const char* message;
};

class Bad : public ::testing::TestWithParam<BadSettings> {};

TEST_P(Bad, IsToldExactly) {
  EXPECT_EQ(mistakes_of(GetParam().text), GetParam().message);
}

#define WAGON "[wagon]\nlength = 6\nwidth = 2.7\nheight = 2.4\n"

INSTANTIATE_TEST_SUITE_P(
    Settings, Bad,
    ::testing::Values(
        BadSettings{"not_toml", "[unit\nname = 1",
                    "unit.toml:1: not TOML: Error while parsing table header: expected ']', saw "
                    "'\\n'"},
        BadSettings{"twice", "[rig]\nblob = \"a\"\nblob = \"b\"",
                    "unit.toml:3: not TOML: Error while parsing key-value pair: cannot redefine "
                    "existing string 'blob'"},
        BadSettings{"section", "[pipelin]\n",
                    "unit.toml:1: pipelin: unknown key; did you mean pipeline?"},
        BadSettings{"section_form", "pipeline = 3",
                    "unit.toml:1: pipeline = 3: must be written as [pipeline]"},
        BadSettings{"list_form", "[sensor]\nname = \"k0\"",
                    "unit.toml:1: sensor = a table: must be written as [[sensor]]"},
        BadSettings{"nothing_near", "[rig]\nxyzzy = 1",
                    "unit.toml:2: rig.xyzzy: unknown key; known here: blob"},
        BadSettings{"nan", "[pipeline]\nleaf_m = nan",
                    "unit.toml:2: pipeline.leaf_m = nan: must be from 0.01 to 0.1"},
        BadSettings{"text_for_number", "[pipeline]\nlearning_s = \"2\"",
                    "unit.toml:2: pipeline.learning_s = \"2\": must be a number"},
        BadSettings{"number_for_flag", "[pipeline]\ncompensate_skew = 1",
                    "unit.toml:2: pipeline.compensate_skew = 1: must be true or false"},
        BadSettings{"empty_name", "[unit]\nname = \"\"",
                    "unit.toml:2: unit.name = \"\": must be a text of 1 to 40 bytes on one line"},
        BadSettings{"wagon_part", "[wagon]\nlength = 6\nwidth = 2.7",
                    "unit.toml:1: wagon.height is missing: length, width and height come together"},
        BadSettings{"wagon_empty", "[wagon]",
                    "unit.toml:1: wagon.length is missing: a wagon needs length, width and height, "
                    "or inside"},
        BadSettings{"wagon_flat", "[wagon]\ninside = {min = [0, 0, 0], max = [6, 2, 0.1]}",
                    "unit.toml:2: wagon.inside.max = [6, 2, 0.1]: must be at least 0.5 m above "
                    "min in x, y and z"},
        BadSettings{"floorless", "[wagon]\ninside = {min = [0, 0, 1], max = [6, 2, 3]}",
                    "unit.toml:2: wagon.inside.min = [0, 0, 1]: the floor, z = 0, must be inside"},
        BadSettings{"roomless", "[[seat]]\nname = \"1\"\nposition = [0, 0]",
                    "unit.toml:1: seat: needs a [wagon] that it stands in"},
        BadSettings{"zone_corners", WAGON "[[zone]]\nname = \"z\"\npolygon = [[0, 0], [1, 0]]",
                    "unit.toml:7: zone 1.polygon = [[0, 0], [1, 0]]: must have 3 to 16 corners"},
        BadSettings{"zone_crossed",
                    WAGON "[[zone]]\nname = \"z\"\npolygon = [[0, 0], [1, 1], [1, 0], [0, 1]]",
                    "unit.toml:7: zone 1.polygon = [[0, 0], [1, 1], [1, 0], [0, 1]]: its "
                    "sides cross each other or enclose nothing"},
        BadSettings{"zone_outside",
                    WAGON "[[zone]]\nname = \"z\"\npolygon = [[0, 0], [60, 0], [60, 2]]",
                    "unit.toml:7: zone 1.polygon = [[0, 0], [60, 0], [60, 2]]: must lie in "
                    "the wagon, x from 0 to 6, y from 0 to 2.7"},
        BadSettings{"zone_twice",
                    WAGON "[[zone]]\nname = \"z\"\npolygon = [[0, 0], [1, 0], [1, 1]]\n"
                          "[[zone]]\nname = \"z\"\npolygon = [[0, 0], [1, 0], [1, 1]]",
                    "unit.toml:9: zone 2.name = \"z\": another zone has this name"},
        BadSettings{"seat_far", WAGON "[[seat]]\nname = \"1\"\nposition = [1, 9]",
                    "unit.toml:7: seat 1.position = [1, 9]: must lie in the wagon, x from 0 to 6, "
                    "y from 0 to 2.7"},
        BadSettings{
            "seat_point", WAGON "[[seat]]\nname = \"1\"\nposition = [1, 2, 3]",
            "unit.toml:7: seat 1.position = [1, 2, 3]: must be 2 numbers from -1000 to 1000"},
        BadSettings{"door_point", WAGON "[[door]]\nname = \"d\"\nfrom = [1, 0]\nto = [1, 0]",
                    "unit.toml:8: door 1.to = [1, 0]: must differ from where the threshold begins"},
        BadSettings{"mask_inverted",
                    WAGON "[[window]]\nname = \"w\"\nmin = [1, 1, 1]\nmax = [0, 2, 2]",
                    "unit.toml:8: window 1.max = [0, 2, 2]: must not be below min in x, y or z"},
        BadSettings{"sensor_kind",
                    "[[sensor]]\nname = \"k0\"\nkind = \"lidar\"\nsource = \"recording\"\n"
                    "file = \"a\"",
                    "unit.toml:3: sensor 1.kind = \"lidar\": must be \"kinect\" or \"stereo\""},
        BadSettings{"sensor_source", "[[sensor]]\nname = \"k0\"",
                    "unit.toml:1: sensor 1.source is missing: must be \"device\", \"recording\" or "
                    "\"simulated\""},
        BadSettings{"sensor_file", "[[sensor]]\nname = \"k0\"\nsource = \"recording\"",
                    "unit.toml:1: sensor 1.file is missing: a recorded sensor needs its recording"},
        BadSettings{"sensor_sceneless", "[[sensor]]\nname = \"k0\"\nsource = \"simulated\"",
                    "unit.toml:1: sensor: a simulated sensor needs a [demo] section with a scene"},
        BadSettings{"sensor_loop",
                    "[[sensor]]\nname = \"k0\"\nsource = \"device\"\ndevice = \"1-1\"\n"
                    "loop = true",
                    "unit.toml:5: sensor 1.loop = true: only a recording can be looped"},
        BadSettings{"sensor_loops_differ",
                    "[[sensor]]\nname = \"k0\"\nsource = \"recording\"\nfile = \"a\"\nloop = true\n"
                    "[[sensor]]\nname = \"k1\"\nsource = \"recording\"\nfile = \"a\"",
                    "unit.toml:9: sensor 2.file = \"a\": another sensor has this recording; loop "
                    "must be the same for both"},
        BadSettings{"sensor_trigger",
                    "[[sensor]]\nname = \"s0\"\nkind = \"stereo\"\nsource = \"device\"\n"
                    "device = \"1\"\ntrigger = \"soon\"",
                    "unit.toml:6: sensor 1.trigger = \"soon\": must be \"free\", \"external\" or "
                    "\"together\""},
        BadSettings{
            "sensor_triggerless",
            "[[sensor]]\nname = \"k0\"\nsource = \"device\"\ndevice = \"1-1\"\n"
            "trigger = \"together\"",
            "unit.toml:5: sensor 1.trigger = \"together\": belongs to kind = \"stereo\" with "
            "source = \"device\""},
        BadSettings{"capture_grouping", "[capture]\ngrouping = \"barier\"",
                    "unit.toml:2: capture.grouping = \"barier\": must be \"hardware\" or "
                    "\"barrier\""},
        BadSettings{"capture_timer", "[capture]\ngrouping = \"barrier\"\nbarrier_hz = 0",
                    "unit.toml:3: capture.barrier_hz = 0: must be from 1 to 60"},
        BadSettings{"capture_timerless", "[capture]\nbarrier_hz = 14.5",
                    "unit.toml:2: capture.barrier_hz = 14.5: belongs to grouping = \"barrier\""},
        BadSettings{
            "capture_triggered",
            "[[sensor]]\nname = \"s0\"\nkind = \"stereo\"\nsource = \"device\"\n"
            "device = \"1\"\ntrigger = \"together\"\n[capture]\ngrouping = \"barrier\"",
            "unit.toml:7: capture: grouping = \"barrier\" has no ticks at which sensors "
            "with trigger = \"together\" could be triggered; take \"free\" or \"external\""},
        BadSettings{
            "sensor_trim",
            "[[sensor]]\nname = \"k0\"\nsource = \"recording\"\nfile = \"a\"\n"
            "trim_m = [5, 1]",
            "unit.toml:5: sensor 1.trim_m = [5, 1]: must be [near, far] with near below far"},
        BadSettings{"host", "[web]\nhost = \"localhost\"",
                    "unit.toml:2: web.host = \"localhost\": must be a numeric address, such as "
                    "127.0.0.1 or 0.0.0.0"},
        BadSettings{"port", "[web]\nport = -1",
                    "unit.toml:2: web.port = -1: must be a whole number from 0 to 65535"},
        BadSettings{"tokens_equal",
                    "[web.tokens]\nread = \"0123456789abcdef\"\nadmin = \"0123456789abcdef\"",
                    "unit.toml:3: web.tokens.admin: must differ from the read token"},
        BadSettings{
            "demo", "[demo]\nspeed = 0",
            "unit.toml:1: demo.scene is missing: the simulated wagon is described by a scene\n"
            "unit.toml:2: demo.speed = 0: must be from 0.01 to 100"}),
    [](const auto& parameter) { return std::string(parameter.param.what); });

TEST(Settings, SayHowFramesAreGrouped) {
  EXPECT_EQ(read("").capture.grouping, "hardware");
  const Settings settings = read("[capture]\ngrouping = \"barrier\"\nbarrier_hz = 14");
  EXPECT_EQ(settings.capture.grouping, "barrier");
  EXPECT_DOUBLE_EQ(settings.capture.barrier_hz, 14);
}

TEST(Settings, BoundTheNumberOfThings) {
  std::string text = WAGON;
  for (int i = 0; i < 17; ++i)
    text += "[[door]]\nname = \"" + std::to_string(i) + "\"\nfrom = [1, 0]\nto = [2, 0]\n";
  EXPECT_EQ(mistakes_of(text),
            "unit.toml:70: door 17.name = \"16\": there can be at most 16 of these");
}

TEST(Settings, RefuseAHugeText) {
  EXPECT_THAT(mistakes_of(std::string((1 << 20) + 1, '#')), HasSubstr("1048577 bytes are more"));
}

}  // namespace
}  // namespace wagonsight
