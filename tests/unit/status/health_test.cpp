#include "status/health.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "sample_status.h"

namespace wagonsight {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::vector<std::string> ids(const Health& health) {
  std::vector<std::string> out;
  for (const Fault& fault : health.faults)
    out.push_back(fault.subject.empty() ? fault.id : fault.id + " " + fault.subject);
  return out;
}

// Every fault is to help a person: a sentence of what is wrong and one of what to do.
void expect_sentences(const Health& health) {
  for (const Fault& fault : health.faults) {
    EXPECT_THAT(fault.cause, testing::EndsWith(".")) << fault.id;
    EXPECT_THAT(fault.next_action, testing::EndsWith(".")) << fault.id;
  }
}

TEST(Health, TellsWhenAndWhyItCrashed) {
  const SampleStatus sample;  // has run for a hundred seconds
  sample.unit->last_crash = {true, 2, 0, 1, "a bad memory access (SIGSEGV)"};
  const Health health = assess(sample.input());
  EXPECT_EQ(health.faults.front().cause,
            "The daemon was started again 102 s ago after a crash: a bad memory access (SIGSEGV).");
}

TEST(Health, TellsWhyFewerInstantsAreWorkedOn) {
  SampleStatus sample;
  ThermalStatus& thermal = sample.snapshot->thermal;
  thermal = {true, 71, "x86_pkg_temp", ThermalBand::kNormal, 0, 0};
  EXPECT_EQ(assess(sample.input()).verdict, Verdict::kOk);
  thermal = {true, 84, "x86_pkg_temp", ThermalBand::kWarm, 15, 7};
  const Health health = assess(sample.input());
  EXPECT_EQ(health.verdict, Verdict::kDegraded);
  EXPECT_TRUE(health.ready) << "it works, only slower";
  EXPECT_THAT(ids(health), ElementsAre("computer_hot x86_pkg_temp"));
  EXPECT_THAT(health.faults.front().cause, HasSubstr("84 degrees"));
  EXPECT_THAT(health.faults.front().cause, HasSubstr("15 instants"));
  expect_sentences(health);
}

TEST(Health, SaysThatAllIsWell) {
  const SampleStatus sample;
  const Health health = assess(sample.input());
  EXPECT_EQ(health.verdict, Verdict::kOk);
  EXPECT_TRUE(health.ready);
  EXPECT_THAT(ids(health), ElementsAre());
  EXPECT_EQ(health.sentence, "2 sensors watch the wagon; 1 person is inside.");
}

TEST(Health, TellsADriversCauseAndItsAdvice) {
  SampleStatus sample;
  SensorStatus& sensor = sample.snapshot->sensors[1];
  sensor.state = SensorState::kLost;
  sensor.last_good = sample.snapshot->time - 7;
  sensor.trouble = "the Kinect was unplugged; check its plug";
  const Health health = assess(sample.input());
  ASSERT_EQ(health.faults.size(), 1U);
  EXPECT_EQ(health.faults[0].cause, "Sensor k1 has been silent for 7 s: the Kinect was unplugged.");
  EXPECT_EQ(health.faults[0].next_action, "Check its plug.");
}

struct Broken {
  const char* name;
  void (*breaks)(Snapshot&, UnitInfo&);
  std::vector<std::string> faults;
  Verdict verdict;
  bool ready;
};

class HealthFault : public testing::TestWithParam<Broken> {};

TEST_P(HealthFault, IsFoundAndExplained) {
  SampleStatus sample;
  GetParam().breaks(*sample.snapshot, *sample.unit);
  const Health health = assess(sample.input());
  EXPECT_EQ(ids(health), GetParam().faults);
  EXPECT_EQ(health.verdict, GetParam().verdict);
  EXPECT_EQ(health.ready, GetParam().ready);
  expect_sentences(health);
}

const Broken kBroken[] = {
    {"StereoMisaligned",
     [](Snapshot& s, UnitInfo&) {
       s.sensors[1].stereo.present = s.sensors[1].stereo.misaligned = true;
       s.sensors[1].stereo.row_offset_px = -1.8;
     },
     {"stereo_misaligned k1"},
     Verdict::kDegraded,
     true},
    {"StereoUnusable",
     [](Snapshot& s, UnitInfo&) {
       s.sensors[0].stereo.present = true;
       s.sensors[0].stereo.unusable_s = 12;
     },
     {"stereo_unusable k0"},
     Verdict::kDegraded,
     true},
    {"OneSensorLost",
     [](Snapshot& s, UnitInfo&) { s.sensors[1].state = SensorState::kLost; },
     {"sensor_lost k1"},
     Verdict::kDegraded,
     true},
    {"Recording",
     [](Snapshot& s, UnitInfo&) { s.recording.state = RecordingState::kOn; },
     {"recording"},
     Verdict::kOk,
     true},
    {"RecordingWithoutDisk",
     [](Snapshot& s, UnitInfo&) {
       s.recording.state = RecordingState::kNoDisk;
       s.recording.trouble = "depot: No space left on device.";
       s.recording.dropped = 7;
     },
     {"recording_failed", "recording_drops"},
     Verdict::kOk,
     true},
    {"SensorLostWithACause",
     [](Snapshot& s, UnitInfo&) {
       s.sensors[1].state = SensorState::kLost;
       s.sensors[1].trouble = "the Kinect was unplugged; check its plug";
     },
     {"sensor_lost k1"},
     Verdict::kDegraded,
     true},
    {"SensorRunsWithARemark",
     [](Snapshot& s, UnitInfo&) {
       s.sensors[1].trouble = "another Kinect is on the same USB bus; give each its own controller";
     },
     {"sensor_trouble k1"},
     Verdict::kDegraded,
     true},
    {"AllSensorsLost",
     [](Snapshot& s, UnitInfo&) {
       for (SensorStatus& sensor : s.sensors) sensor.state = SensorState::kLost;
     },
     {"all_sensors_lost", "sensor_lost k0", "sensor_lost k1"},
     Verdict::kFailed,
     false},
    {"NoSensor",
     [](Snapshot& s, UnitInfo&) { s.sensors.clear(); },
     {"no_sensor"},
     Verdict::kFailed,
     false},
    {"RateLow",
     [](Snapshot& s, UnitInfo&) { s.sensors[0].fps = 20; },
     {"sensor_rate_low k0"},
     Verdict::kDegraded,
     true},
    {"AllSlow",
     [](Snapshot& s, UnitInfo&) {
       for (SensorStatus& sensor : s.sensors) sensor.fps = 12;
     },
     {"overload"},
     Verdict::kDegraded,
     true},
    {"Drops",
     [](Snapshot& s, UnitInfo&) { s.sensors[0].dropped_share = 0.02; },
     {"sensor_drops k0"},
     Verdict::kDegraded,
     true},
    {"Skew",
     [](Snapshot& s, UnitInfo&) { s.sensors[1].skew_ms = -25; },
     {"sensor_skew k1"},
     Verdict::kDegraded,
     true},
    {"SkewOfABarrier",
     [](Snapshot& s, UnitInfo& unit) {
       s.sensors[1].skew_ms = -25;
       unit.has_barrier = true;
     },
     {},
     Verdict::kOk,
     true},
    {"Hot",
     [](Snapshot& s, UnitInfo&) {
       s.sensors[0].has_temperature = true;
       s.sensors[0].temperature_c = 85;
     },
     {"sensor_hot k0"},
     Verdict::kDegraded,
     true},
    {"RestartedAfterACrash",
     [](Snapshot&, UnitInfo& unit) {
       unit.last_crash.present = true;
       unit.last_crash.before_start_s = 2;
       unit.last_crash.reason = "a bad memory access (SIGSEGV)";
     },
     {"restarted"},
     Verdict::kOk,
     true},
    {"SafeModeSpeaksOfNothingElse",
     [](Snapshot& s, UnitInfo& unit) {
       s.sensors.clear();
       unit.safe_mode = true;
       unit.last_crash.present = true;
       unit.last_crash.recent = 4;
       unit.last_crash.reason = "a bad memory access (SIGSEGV)";
     },
     {"safe_mode"},
     Verdict::kFailed,
     false},
    {"PipelineLate",
     [](Snapshot& s, UnitInfo&) { s.frame.time = 90; },
     {"pipeline_late"},
     Verdict::kFailed,
     false},
    {"PipelineNeverRan",
     [](Snapshot& s, UnitInfo&) { s.framesets = 0; },
     {"pipeline_late"},
     Verdict::kFailed,
     false},
    {"PipelineDrops",
     [](Snapshot& s, UnitInfo&) { s.framesets_dropped_share = 0.05; },
     {"pipeline_drops"},
     Verdict::kDegraded,
     true},
    {"Learning",
     [](Snapshot& s, UnitInfo&) { s.learning = true; },
     {"learning"},
     Verdict::kDegraded,
     false},
    {"Starting",
     [](Snapshot& s, UnitInfo&) {
       s.time = 3;
       s.framesets = 0;
       s.learning = true;
     },
     {"starting"},
     Verdict::kDegraded,
     false},
    {"LearningLosesFrames",
     [](Snapshot& s, UnitInfo&) {
       s.learning = true;
       s.framesets_dropped_share = 0.2;
       for (SensorStatus& sensor : s.sensors) {
         sensor.state = SensorState::kLearning;
         sensor.fps = 9;
         sensor.dropped_share = 0.2;
       }
     },
     {"learning"},
     Verdict::kDegraded,
     false},
    {"NoCalibration",
     [](Snapshot& s, UnitInfo&) { s.calibration.present = false; },
     {"no_calibration"},
     Verdict::kDegraded,
     true},
    {"CalibrationPoor",
     [](Snapshot& s, UnitInfo&) { s.sensors[0].rms_px = 2.41; },
     {"calibration_poor k0"},
     Verdict::kDegraded,
     true},
    {"Drift",
     [](Snapshot& s, UnitInfo&) {
       s.calibration.drift_alarm = true;
       s.calibration.drift_text = "k0 turned by 1.2 degrees.";
     },
     {"drift"},
     Verdict::kDegraded,
     true},
    {"Memory",
     [](Snapshot& s, UnitInfo& unit) {
       unit.resident_limit = 1000;
       s.resident_bytes = 1001;
     },
     {"memory"},
     Verdict::kDegraded,
     true},
    {"Allocation",
     [](Snapshot& s, UnitInfo&) { s.allocations_sealed = 1; },
     {"allocation"},
     Verdict::kOk,
     true},
    {"FrameSlots",
     [](Snapshot& s, UnitInfo&) { s.slots_in_use = s.slots_capacity = 8; },
     {"frame_slots"},
     Verdict::kDegraded,
     true},
    {"TimeUnsynchronised",
     [](Snapshot& s, UnitInfo&) { s.unix_time = 0; },
     {"time_unsynchronised"},
     Verdict::kOk,
     true},
};

INSTANTIATE_TEST_SUITE_P(Each, HealthFault, testing::ValuesIn(kBroken),
                         [](const auto& each) { return each.param.name; });

TEST(Health, TellsTheHeaviestFaultFirst) {
  SampleStatus sample;
  sample.snapshot->unix_time = 0;
  sample.snapshot->calibration.present = false;
  sample.snapshot->frame.time = 50;
  const Health health = assess(sample.input());
  EXPECT_THAT(ids(health), ElementsAre("pipeline_late", "no_calibration", "time_unsynchronised"));
  EXPECT_EQ(health.sentence, "The newest answer is 50 s old.");
}

TEST(Health, FailsWhenTheDaemonIsSilent) {
  const SampleStatus sample;
  StatusInput input = sample.input();
  input.snapshot_age_s = 12;
  EXPECT_EQ(assess(input).verdict, Verdict::kFailed);
  EXPECT_EQ(assess(input).sentence, "The daemon has said nothing for 12 s.");
  input.snapshot = nullptr;
  EXPECT_THAT(ids(assess(input)), ElementsAre("daemon_silent"));
  EXPECT_FALSE(assess(input).ready);
}

}  // namespace
}  // namespace wagonsight
