#include <gmock/gmock.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>

#include "program.h"

namespace wagonsight {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using testing::kCamera;
using testing::read_text;
using testing::write_text;

std::vector<json> lines_of(const testing::fs::path& path) {
  std::istringstream text(read_text(path));
  std::vector<json> lines;
  for (std::string line; std::getline(text, line);) lines.push_back(json::parse(line));
  return lines;
}

class Replay : public testing::ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_text(at("scene.toml"), testing::kSmallScene);
    write_text(at("camera.toml"), kCamera);
  }
  // The scene with a second Kinect opposite.
  void write_two_kinects(const std::string& file, const std::string& more = "") const {
    write_text(at(file), std::string(testing::kSmallScene) +
                             "[[sensor]]\nname = \"k1\"\nkind = \"kinect\"\n"
                             "position = [4.9, 1.35, 2.2]\nlook_at = [2.0, 1.35, 0.6]\n" +
                             more);
  }
  void simulate(double seconds) const {
    must_run(
        fmt::format("simulate --scene scene.toml --seconds {} --seed 3 --out sim.mcap --truth "
                    "truth.jsonl --rig-out rig.blob --images images",
                    seconds));
  }
};

TEST_F(Replay, TellsOneLineAFrameAndTheSameBytesEveryTime) {
  simulate(3);
  must_run("replay sim.mcap --out a.jsonl");
  must_run("replay sim.mcap --out b.jsonl --timing t.json --clouds clouds");
  EXPECT_EQ(read_text(at("a.jsonl")), read_text(at("b.jsonl")));
  const auto frames = json::parse(must_run("inspect --json sim.mcap").out).at("frames");
  const auto lines = lines_of(at("a.jsonl"));
  EXPECT_EQ(lines.size(), frames);
  EXPECT_EQ(lines_of(at("truth.jsonl")).size(), frames);
  for (std::size_t i = 1; i < lines.size(); ++i)
    EXPECT_GT(lines[i].at("time"), lines[i - 1].at("time"));
  const json timing = json::parse(read_text(at("t.json")));
  EXPECT_EQ(timing.at("framesets"), frames);
  EXPECT_GT(timing.at("stages").at("extract").at("p99_ms"), 0);
  const auto clouds = std::distance(testing::fs::directory_iterator(at("clouds")), {});
  EXPECT_EQ(static_cast<std::size_t>(clouds), lines.size());
}

TEST_F(Replay, FindsTheSimulatedPassenger) {
  simulate(4);
  must_run("replay sim.mcap --out people.jsonl --background whole");
  const auto scores =
      json::parse(must_run("evaluate --truth truth.jsonl --people people.jsonl --json").out);
  EXPECT_THAT(must_run("evaluate --truth truth.jsonl --people people.jsonl").out,
              HasSubstr("MOTA"));
  const auto lines = lines_of(at("people.jsonl"));
  const auto with_people = std::count_if(
      lines.begin(), lines.end(), [](const json& line) { return line.at("people").size() == 1; });
  EXPECT_GT(with_people, static_cast<std::ptrdiff_t>(lines.size() / 3)) << scores.dump(1);
}

TEST_F(Replay, FindsTheFloorOfAnImportWithoutAPose) {
  simulate(1);
  must_run("import --depth images/k0 --camera camera.toml --out import.mcap");
  const auto said = must_run("replay import.mcap --out people.jsonl");
  EXPECT_THAT(said.out, HasSubstr("background whole"));
  const auto frames = json::parse(must_run("inspect --json import.mcap").out).at("frames");
  EXPECT_EQ(lines_of(at("people.jsonl")).size(), frames);
}

// Two cameras that were imported apart and put into one recording; nobody knows their poses.
TEST_F(Replay, TakesOneOfSeveralSensorsWithoutPoses) {
  simulate(0.5);
  must_run("import --depth images/k0 --camera camera.toml --out first.mcap");
  std::string second(kCamera);
  second.replace(second.find("k0"), 2, "k1");
  write_text(at("second.toml"), second);
  must_run("import --depth images/k0 --camera second.toml --out second.mcap");
  write_text(at("both.toml"),
             "[[sensor]]\nname = \"k0\"\nsource = \"recording\"\nfile = \"first.mcap\"\n"
             "[[sensor]]\nname = \"k1\"\nsource = \"recording\"\nfile = \"second.mcap\"\n");
  must_run("record --config both.toml --seconds 1 --out both.mcap");
  EXPECT_EQ(run("replay both.mcap --out both.jsonl").err,
            "wagonsight replay: both.mcap has several sensors (k0, k1), and their poses are not "
            "known: choose one with --sensor, or calibrate them and give the blob with --rig\n");
  must_run("replay both.mcap --sensor k1 --out one.jsonl");
  must_run("replay second.mcap --out alone.jsonl");
  EXPECT_GT(lines_of(at("one.jsonl")).size(), 10U);
  EXPECT_EQ(read_text(at("one.jsonl")), read_text(at("alone.jsonl")));
}

// A whole wagon's sensors, all that the settings' scene has.
TEST_F(Replay, RecordsEverySensorOfTheSettings) {
  write_two_kinects("two.toml");
  write_text(at("live.toml"), "[demo]\nscene = \"two.toml\"\n");
  must_run("record --config live.toml --seconds 0.4 --out all.mcap");
  const json told = json::parse(must_run("inspect --json all.mcap").out);
  ASSERT_EQ(told.at("sensors").size(), 2U);
  for (const json& sensor : told.at("sensors")) EXPECT_GT(sensor.at("frames"), 8) << sensor;
}

// As live: ten signals a second instead of a set for each frame of the first sensor.
TEST_F(Replay, GroupsFramesAsTheSettingsSay) {
  write_two_kinects("scene.toml", "phase_ms = 10\n");
  simulate(2);
  const std::string demo = "[demo]\nscene = \"scene.toml\"\n";
  write_text(at("hardware.toml"), demo);
  write_text(at("barrier.toml"), demo + "[capture]\ngrouping = \"barrier\"\nbarrier_hz = 10\n");
  must_run("replay sim.mcap --config hardware.toml --out a.jsonl");
  must_run("replay sim.mcap --config barrier.toml --out b.jsonl");
  const auto by_light = lines_of(at("a.jsonl"));
  const auto by_barrier = lines_of(at("b.jsonl"));
  EXPECT_GE(by_light.size(), 57U);
  EXPECT_GE(by_barrier.size(), 18U);
  EXPECT_LE(by_barrier.size(), 21U);
  for (const json& line : by_barrier) {
    // The instant is the middle between the two.
    const json& skews = line.at("skew_ms");
    if (skews.size() < 2) continue;
    EXPECT_NEAR(skews.at("k0").get<double>(), -skews.at("k1").get<double>(), 0.011);
  }
}

TEST_F(Replay, TakesUpABackgroundThatWasLearnedBefore) {
  simulate(1.5);
  must_run("replay sim.mcap --out a.jsonl --background whole --save-background room.background");
  must_run("replay sim.mcap --out b.jsonl --background room.background");
  must_run("replay sim.mcap --out c.jsonl --background room.background");
  EXPECT_EQ(read_text(at("b.jsonl")), read_text(at("c.jsonl")));
  write_text(at("bad.background"), "not a background");
  const auto refused = run("replay sim.mcap --out d.jsonl --background bad.background");
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(refused.err, HasSubstr("bad.background: "));
}

TEST_F(Replay, PlaysACutRecordingToItsLastWholeChunk) {
  simulate(1);
  const std::string whole = read_text(at("sim.mcap"));
  write_text(at("cut.mcap"), std::string_view(whole).substr(0, whole.size() * 2 / 3));
  const auto said = must_run("replay cut.mcap --out cut.jsonl");
  EXPECT_THAT(said.err, HasSubstr("cut.mcap has no end"));
  must_run("replay sim.mcap --out whole.jsonl");
  const std::string cut_lines = read_text(at("cut.jsonl"));
  EXPECT_GT(cut_lines.size(), 0U);
  EXPECT_EQ(read_text(at("whole.jsonl")).substr(0, cut_lines.size()), cut_lines);
}

TEST_F(Replay, StopsAtADamagedChunkUnlessToldToSkipIt) {
  simulate(1);
  std::string bytes = read_text(at("sim.mcap"));
  bytes[bytes.size() * 3 / 4] = static_cast<char>(bytes[bytes.size() * 3 / 4] ^ 0x20);
  write_text(at("bad.mcap"), bytes);
  const auto stopped = run("replay bad.mcap --out a.jsonl");
  EXPECT_EQ(stopped.exit_code, 1);
  EXPECT_THAT(stopped.err, HasSubstr("bad.mcap chunk "));
  EXPECT_THAT(stopped.err, HasSubstr("is damaged"));
  EXPECT_THAT(stopped.err, HasSubstr("--skip-damaged"));
  const auto skipped = must_run("replay bad.mcap --out b.jsonl --skip-damaged");
  EXPECT_THAT(skipped.err, HasSubstr("1 damaged chunks were left out"));
}

TEST_F(Replay, UsesAnotherCalibrationWhenGiven) {
  simulate(0.5);
  must_run("replay sim.mcap --rig rig.blob --out a.jsonl");
  must_run("replay sim.mcap --out b.jsonl");
  EXPECT_EQ(read_text(at("a.jsonl")), read_text(at("b.jsonl")));
  EXPECT_THAT(must_run("inspect rig.blob").out, HasSubstr("a calibration blob"));
}

}  // namespace
}  // namespace wagonsight
