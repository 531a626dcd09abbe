#pragma once

#include <memory>
#include <string>
#include <vector>

#include "device_bench.h"
#include "kinect/kinect_sensor.h"
#include "kinect_unit.h"
#include "usb_bus.h"

namespace wagonsight::device {

// Some Kinects, each on its own bus, and the sensors that drive them.
class KinectBench final : public DeviceBench {
 public:
  // `change` may change a unit's options before it is plugged in.
  using Change = std::function<void(std::size_t unit, KinectUnit::Options& options)>;
  // What a unit sees in its frame `number`, in raw disparities; the same whenever it is asked.
  using Picture =
      std::function<void(std::size_t unit, std::uint32_t number, std::span<std::uint16_t> raw)>;
  explicit KinectBench(std::size_t count, const Change& change = {}, Picture picture = {});
  ~KinectBench() override;
  KinectBench(const KinectBench&) = delete;
  KinectBench& operator=(const KinectBench&) = delete;

  // Changes faults while everything is still.
  KinectFaults& faults(std::size_t unit) { return units_[unit]->faults; }
  KinectUnit& unit(std::size_t index) { return *units_[index]; }
  std::shared_ptr<KinectUnit> shared_unit(std::size_t index) { return units_[index]; }
  const KinectSensor& sensor(std::size_t index) const { return *sensors_[index]; }
  // Which of the unit's frames this is.
  std::uint32_t frame_number(std::size_t unit, const FrameSlot& slot) const;
  static int bus_of(std::size_t unit) { return static_cast<int>(unit) + 1; }

 private:
  std::vector<SentFrame> sent_frames(std::size_t unit) const override;
  void check(std::size_t unit, const FrameSlot& slot, Log& log) override;

  Picture picture_;
  std::vector<std::shared_ptr<KinectUnit>> units_;
  std::vector<std::unique_ptr<KinectSensor>> sensors_;
  std::vector<std::uint16_t> raw_;
  std::vector<std::vector<std::uint16_t>> tables_;  // by unit
};

}  // namespace wagonsight::device
