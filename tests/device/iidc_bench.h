#pragma once

#include <memory>
#include <string>
#include <vector>

#include "device_bench.h"
#include "iidc/iidc_sensor.h"
#include "iidc_unit.h"

namespace wagonsight::device {

// Some stereo cameras, two to a bus, and the sensors that drive them.
class IidcBench final : public DeviceBench {
 public:
  // `change` may change a unit's and its sensor's options before it is plugged in.
  using Change =
      std::function<void(std::size_t unit, IidcUnit::Options& options, IidcOptions& sensor)>;
  explicit IidcBench(std::size_t count, const Change& change = {});
  ~IidcBench() override;
  IidcBench(const IidcBench&) = delete;
  IidcBench& operator=(const IidcBench&) = delete;

  // Changes faults while everything is still.
  IidcFaults& faults(std::size_t unit) { return units_[unit]->faults; }
  IidcUnit& unit(std::size_t index) { return *units_[index]; }
  std::shared_ptr<IidcUnit> shared_unit(std::size_t index) { return units_[index]; }
  IidcSensor& sensor(std::size_t index) { return *sensors_[index]; }
  const IidcSensor& sensor(std::size_t index) const { return *sensors_[index]; }
  static int bus_of(std::size_t unit) { return static_cast<int>(unit / 2); }
  // When the light of the frame with this number was taken.
  Nanoseconds light_of(std::size_t unit, std::uint32_t number) const;

 private:
  std::vector<SentFrame> sent_frames(std::size_t unit) const override;
  void check(std::size_t unit, const FrameSlot& slot, Log& log) override;

  std::vector<std::shared_ptr<IidcUnit>> units_;
  std::vector<std::unique_ptr<IidcSensor>> sensors_;
  std::vector<std::uint16_t> gray_;
};

}  // namespace wagonsight::device
