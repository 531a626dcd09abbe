#pragma once

#include <memory>

#include "status/health.h"

namespace wagonsight {

// A unit with two sensors at which nothing is wrong, for tests that then break one thing.
struct SampleStatus {
  SampleStatus() {
    unit->name = "wagon 7";
    unit->version = "test";
    Snapshot& s = *snapshot;
    s.time = 100;
    s.unix_time = 1.7e9;
    s.framesets = 3000;
    s.frameset_rate = 30;
    s.frame.time = 99.98;
    s.calibration.present = true;
    s.calibration.source = "rig.blob";
    for (const char* name : {"k0", "k1"}) {
      SensorStatus sensor;
      sensor.name = name;
      sensor.kind = "kinect";
      sensor.state = SensorState::kOk;
      sensor.fps = sensor.expected_fps = 30;
      sensor.frames = 3000;
      sensor.last_good = 99.99;
      s.sensors.push_back(sensor);
    }
    Person person;
    person.id = 4;
    person.position = {1, 2};
    s.frame.people.push_back(person);
    s.occupancy.count = 1;
    s.occupancy.observed_share = 0.9;
    s.occupancy.zones.push_back({"front", 1, 10, 0.9});
    s.occupancy.seats.push_back({"1A", Occupied::kOccupied, 4});
    s.occupancy.doors.push_back({"left", 3, 2});
    s.stages.push_back({"extract", 2, 2, 3});
  }

  StatusInput input() const { return {snapshot.get(), 0.05, unit.get(), nullptr}; }

  std::unique_ptr<Snapshot> snapshot = std::make_unique<Snapshot>();
  std::unique_ptr<UnitInfo> unit = std::make_unique<UnitInfo>();
};

}  // namespace wagonsight
