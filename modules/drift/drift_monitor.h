#pragma once

#include <array>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "drift/sensor_drift.h"
#include "drift/static_model.h"
#include "rig/ray_table.h"
#include "rig/rig.h"

namespace wagonsight {

// All sensors of a unit. Bounded: about a megabyte a sensor, made at the start, a little more while
// a judgement lasts. One thread, of low priority; never the data path's.
class DriftMonitor {
 public:
  // `rays` by sensor index, must outlive it. `model`: of the day of calibration; views that it has
  // not, or has for another image size, are learned.
  DriftMonitor(const Rig& rig, const std::array<RayTable, kSensorsMax>& rays,
               const StaticModel& model, const DriftOptions& options = {});

  const SensorDrift& sensor(std::size_t index) const { return *sensors_[index]; }
  std::size_t sensor_count() const { return sensors_.size(); }
  // See SensorDrift::add.
  bool add(std::size_t sensor, std::span<const std::uint16_t> readings,
           std::span<const KeepOut> people) {
    return sensors_[sensor]->add(readings, people);
  }

  // What is known of the static wagon by now; views still being learned are empty.
  StaticModel model() const;
  bool alarm() const;
  // One sentence or a few: who moved by how much, whose depth has another scale, what cannot be
  // told. Empty when there is nothing to say.
  std::string text() const;

 private:
  std::vector<Name> names_;
  std::vector<std::unique_ptr<SensorDrift>> sensors_;
  std::array<std::uint8_t, 32> blob_sha256_{};
};

}  // namespace wagonsight
