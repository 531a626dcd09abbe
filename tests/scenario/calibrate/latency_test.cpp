// How late sensors stamp their frames, from a recording of a ball that is waved: the simulator
// hides the delays, the tool finds them, the replay uses them.
#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include "rig/blob.h"
#include "scenario/cli/program.h"
#include "support/scene_text.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;
using testing::sensor_text;

// The ball swings where two Kinects and a stereo camera look; somebody stands beside it.
std::string scene_text(const std::string& swing) {
  return testing::wagon_text(5.0) +
         sensor_text("k0", "kinect", "0.9, 0.1, 2.3", "2.6, 1.5, 1.0", "stamp_late_ms = 16") +
         sensor_text("k1", "kinect", "4.4, 0.1, 2.3", "2.4, 1.5, 1.0",
                     "stamp_late_ms = 20\nphase_ms = 11\ndrift_ppm = 40") +
         sensor_text("s0", "stereo", "2.4, 0.1, 2.2", "2.5, 1.6, 1.0",
                     "stamp_late_ms = 32\nphase_ms = 5") +
         "[[ball]]\nposition = [2.5, 1.5, 1.4]\nradius = 0.12\nperiod = 1.4\nswing = [" + swing +
         "]\n" + testing::passenger_text("waver", "start = [3.2, 2.1]");
}

class WavedBallProgram : public testing::ProgramTest {
 protected:
  void simulate(const std::string& swing, double seconds) {
    testing::write_text(at("waved.toml"), scene_text(swing));
    const auto made = run_program(
        WAGONSIGHT_TOOL, fmt::format("simulate --scene waved.toml --seconds {} --out waved.mcap "
                                     "--rig-out rig.blob",
                                     seconds));
    ASSERT_EQ(made.exit_code, 0) << made.err;
  }
  Rig rig(const std::string& name) const {
    const std::string text = testing::read_text(at(name));
    // open_blob() wants its bytes aligned.
    std::vector<std::uint32_t> aligned((text.size() + 3) / 4);
    std::copy_n(text.begin(), text.size(), reinterpret_cast<char*>(aligned.data()));
    const auto blob = open_blob(std::as_bytes(std::span(aligned)).first(text.size()));
    EXPECT_TRUE(blob) << (blob ? "" : blob.error().message);
    return blob ? blob->rig : Rig{};
  }
  // The middle of the skews that a replay states of a sensor, milliseconds.
  double skew_ms(const std::string& people, const std::string& sensor) const {
    std::istringstream lines(testing::read_text(at(people)));
    std::vector<double> skews;
    for (std::string line; std::getline(lines, line);) {
      const auto from = line.find("\"skew_ms\"");
      const auto key = line.find("\"" + sensor + "\":", from);
      if (from == std::string::npos || key == std::string::npos) continue;
      skews.push_back(std::stod(line.substr(key + sensor.size() + 3)));
    }
    EXPECT_GT(skews.size(), 20U) << sensor;
    if (skews.empty()) return 0;
    std::nth_element(skews.begin(), skews.begin() + static_cast<long>(skews.size() / 2),
                     skews.end());
    return skews[skews.size() / 2];
  }
};

TEST_F(WavedBallProgram, RecoversTheHiddenDelaysAndReplayUsesThem) {
  simulate("0.45, 0.3, 0.25", 8);
  const auto outcome =
      must_run("latency waved.mcap --rig rig.blob --ball-radius 0.12 --out new.blob");
  const Rig found = rig("new.blob");
  ASSERT_EQ(found.sensors.size(), 3U);
  const auto delay_ms = [&](std::size_t i) { return 1e3 * found.sensors[i].stamp_delay.delay_s; };
  EXPECT_NEAR(delay_ms(1) - delay_ms(0), 4, 2) << outcome.out;
  EXPECT_NEAR(delay_ms(2) - delay_ms(0), 16, 2) << outcome.out;
  EXPECT_THAT(outcome.out, HasSubstr("stereo cameras: 1"));
  const auto told = run_program(WAGONSIGHT_TOOL, "inspect new.blob");
  EXPECT_THAT(told.out, HasSubstr("time stamps 1")) << told.out;

  // By their stamps the Kinects are 15 ms apart, and 11 by their light.
  for (const char* blob : {"rig", "new"}) {
    const auto replayed = run_program(
        WAGONSIGHT_TOOL,
        fmt::format("replay waved.mcap --rig {0}.blob --out {0}.jsonl --background causal", blob));
    ASSERT_EQ(replayed.exit_code, 0) << replayed.err;
  }
  EXPECT_NEAR(skew_ms("rig.jsonl", "k1") - skew_ms("rig.jsonl", "k0"), 15, 1);
  EXPECT_NEAR(skew_ms("new.jsonl", "k1") - skew_ms("new.jsonl", "k0"), 11, 2);
}

TEST_F(WavedBallProgram, ABallThatHangsStillIsRefusedWithASentence) {
  simulate("0, 0, 0", 2);
  const auto outcome = run("latency waved.mcap --rig rig.blob --ball-radius 0.12 --out new.blob");
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("waved.mcap"));
  EXPECT_THAT(outcome.err, HasSubstr("k0"));
  EXPECT_FALSE(testing::fs::exists(at("new.blob")));
}

}  // namespace
}  // namespace wagonsight
