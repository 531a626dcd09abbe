#include "simulate/scene.h"

#include <gmock/gmock.h>

namespace wagonsight {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr const char* kWagon = "[wagon]\nlength = 6\nwidth = 2.7\nheight = 2.4\n";

std::string error_of(const std::string& text) {
  const auto scene = parse_scene(text, "trial.toml");
  return scene ? "" : scene.error().message;
}

struct BadScene {
  const char* label;
  std::string text;
  const char* where;  // file and line
  const char* key;    // key and value
  const char* rule;
};

class BadScenes : public testing::TestWithParam<BadScene> {};

TEST_P(BadScenes, AreRefusedWithFileLineKeyValueAndRule) {
  const BadScene& bad = GetParam();
  EXPECT_THAT(error_of(bad.text),
              AllOf(StartsWith(bad.where), HasSubstr(bad.key), HasSubstr(bad.rule)));
}

const std::string kPost = std::string(kWagon) + "[[passenger]]\n";

INSTANTIATE_TEST_SUITE_P(
    Table, BadScenes,
    testing::Values(
        BadScene{"NoWagon", "[[seat]]\nposition = [1, 1]\n", "trial.toml:", "wagon", "needs"},
        BadScene{"NotToml", "[wagon\nlength = 6\n", "trial.toml:1", "", "not valid TOML"},
        BadScene{"MissingKey", "[wagon]\nlength = 6\nwidth = 2.7\n", "trial.toml:1",
                 "wagon.height = (nothing)", "needed"},
        BadScene{"TooLong", "[wagon]\nlength = 600\nwidth = 2.7\nheight = 2.4\n", "trial.toml:2",
                 "wagon.length = 600", "from 1.5 to 40"},
        BadScene{"TextForNumber", "[wagon]\nlength = \"6 m\"\nwidth = 2.7\nheight = 2.4\n",
                 "trial.toml:2", "wagon.length = ", "must be a number"},
        BadScene{"NotFinite", "[wagon]\nlength = nan\nwidth = 2.7\nheight = 2.4\n", "trial.toml:2",
                 "wagon.length = nan", "must be a number"},
        BadScene{"UnknownTable", std::string(kWagon) + "[[lamp]]\nat = 1\n", "trial.toml:5", "lamp",
                 "no such key"},
        BadScene{"UnknownKey", kPost + "start = [1, 1]\nhat = true\n", "trial.toml:7",
                 "passenger.hat = true", "known are name, build, height"},
        BadScene{"StartOutside", kPost + "start = [7, 1]\n", "trial.toml:6", "passenger.start",
                 "in the wagon"},
        BadScene{"StartNotAPoint", kPost + "start = [1, 1, 1]\n", "trial.toml:6",
                 "passenger.start = [ 1, 1, 1 ]", "2 numbers"},
        BadScene{"NowhereToBe", kPost + "height = 1.7\n", "trial.toml:5", "passenger.start",
                 "start = [x, y], door"},
        BadScene{"UnknownBuild", kPost + "start = [1, 1]\nbuild = \"giant\"\n", "trial.toml:7",
                 "passenger.build = ", "\"adult\", \"child\""},
        BadScene{"UnknownLoad", kPost + "start = [1, 1]\ncarries = [\"dog\"]\n", "trial.toml:7",
                 "passenger.carries", "\"bag\", \"pram\", \"coat\""},
        BadScene{"UnknownAct",
                 kPost + "start = [1, 1]\n[[passenger.do]]\nat = 1\nact = \"dance\"\n",
                 "trial.toml:9", "passenger.do.act = ", "\"enter\""},
        BadScene{"UnknownSeat",
                 kPost + "start = [1, 1]\n[[passenger.do]]\nact = \"sit\"\nseat = \"s9\"\n",
                 "trial.toml:9", "passenger.do.seat = ", "no [[seat]]"},
        BadScene{"NoDoorToEnter", kPost + "start = [1, 1]\n[[passenger.do]]\nact = \"enter\"\n",
                 "trial.toml:8", "passenger.do.act = ", "no [[door]]"},
        BadScene{"WalkNowhere", kPost + "start = [1, 1]\n[[passenger.do]]\nact = \"walk\"\n",
                 "trial.toml:8", "passenger.do.act = ", "walk needs"},
        BadScene{"DropRate",
                 std::string(kWagon) +
                     "[[sensor]]\nposition = [0, 0, 2]\nlook_at = [3, 1, 0]\ndrop_rate = 2\n",
                 "trial.toml:8", "sensor.drop_rate = 2", "from 0 to 1"},
        BadScene{"FaultOfNobody", std::string(kWagon) + "[[fault]]\nkind = \"loss\"\n",
                 "trial.toml:5", "fault.sensor = (nothing)", "needed"},
        BadScene{"TwoOfOneName",
                 std::string(kWagon) +
                     "[[seat]]\nname = \"a\"\nposition = [1, 1]\n[[seat]]\nname = \"a\"\n"
                     "position = [2, 1]\n",
                 "trial.toml:9", "seat.name = ", "another one"},
        BadScene{"TwoCorners", std::string(kWagon) + "[[zone]]\npolygon = [[0, 0], [1, 1]]\n",
                 "trial.toml:6", "zone.polygon = ", "3 to 16 points"},
        BadScene{"ThresholdTooNarrow",
                 std::string(kWagon) + "[[door]]\nfrom = [1, 0]\nto = [1.1, 0]\n", "trial.toml:7",
                 "door.to = ", "0.4 m"}),
    [](const auto& each) { return std::string(each.param.label); });

TEST(SceneTest, ReadsEverythingAndSortsActsByTime) {
  const auto scene = parse_scene(std::string(kWagon) + R"(
[[seat]]
name = "s"
position = [1, 1]
yaw = 90
[[door]]
name = "d"
from = [2, 0]
to = [3.2, 0]
[[passenger]]
name = "A"
door = "d"
carries = ["bag", "coat"]
[[passenger.do]]
at = 9
act = "sit"
seat = "s"
[[passenger.do]]
at = 2
act = "enter"
door = "d"
[[sensor]]
name = "k"
kind = "kinect"
position = [0, 0, 2.3]
look_at = [3, 1, 0]
phase_ms = 4
[[fault]]
at = 3
sensor = "k"
kind = "late"
amount = 80
for = 2
)",
                                 "good.toml");
  ASSERT_TRUE(scene.has_value()) << scene.error().message;
  ASSERT_EQ(scene->passengers.size(), 1U);
  const ScenePassenger& passenger = scene->passengers[0];
  EXPECT_TRUE(passenger.bag && passenger.coat && !passenger.pram);
  ASSERT_EQ(passenger.acts.size(), 2U);
  EXPECT_EQ(passenger.acts[0].kind, ActKind::kEnter);
  EXPECT_EQ(passenger.acts[1].seat, 0);
  EXPECT_NEAR(scene->seats[0].yaw, 1.5707963, 1e-6);
  EXPECT_DOUBLE_EQ(scene->sensors[0].phase_s, 0.004);
  EXPECT_DOUBLE_EQ(scene->faults[0].amount, 0.08);  // stated as milliseconds
}

}  // namespace
}  // namespace wagonsight
