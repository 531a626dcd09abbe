#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "kinect/kinect_sensor.h"
#include "kinect_unit.h"
#include "sensor_thread.h"

namespace wagonsight::device {

// Some Kinects, each on its own bus, and the sensors that drive them, all in virtual time. Every
// pixel of every frame is held against what the unit sent.
class KinectBench {
 public:
  // `change` may change a unit's options before it is plugged in.
  using Change = std::function<void(std::size_t unit, KinectUnit::Options& options)>;
  // What a unit sees in its frame `number`, in raw disparities; the same whenever it is asked.
  using Picture =
      std::function<void(std::size_t unit, std::uint32_t number, std::span<std::uint16_t> raw)>;
  explicit KinectBench(std::size_t count, const Change& change = {}, Picture picture = {});
  ~KinectBench();
  KinectBench(const KinectBench&) = delete;
  KinectBench& operator=(const KinectBench&) = delete;

  // Takes over each frame after its check, damaged ones too, and gives it back to pool().
  using Taker = std::function<void(FrameSlot* slot)>;
  void hand_on(Taker taker) { taker_ = std::move(taker); }
  FramePool& pool() { return pool_; }

  void run(double seconds);
  // Runs until the sensor delivers a good frame, or so long; how long it took, or a negative
  // number.
  double run_until_frame(std::size_t unit, double seconds_max);
  void script(double in_seconds, std::function<void()> deed);
  // Changes faults while everything is still.
  KinectFaults& faults(std::size_t unit) { return units_[unit]->faults; }
  KinectUnit& unit(std::size_t index) { return *units_[index]; }
  std::shared_ptr<KinectUnit> shared_unit(std::size_t index) { return units_[index]; }
  const KinectSensor& sensor(std::size_t index) const { return *sensors_[index]; }
  SensorThread& thread(std::size_t index) { return *threads_[index]; }
  static int bus_of(std::size_t unit) { return static_cast<int>(unit) + 1; }

  struct Delivery {
    std::uint32_t number = 0;  // of the unit's frame
    HostTime instant{}, arrival{};
  };
  struct Log {
    std::vector<Delivery> good;
    std::uint64_t damaged = 0;
    std::uint64_t wrong_pixels = 0;
  };
  const Log& log(std::size_t unit) const { return logs_[unit]; }
  // Of the frames that were sent whole since the first good one (and before the last one): those
  // that were not delivered. Of those delivered: those that were not sent whole, or came twice.
  struct Balance {
    std::uint64_t whole = 0, missing = 0, delivered_damaged = 0, repeated = 0;
  };
  Balance balance(std::size_t unit) const;

 private:
  void take_frames();
  void check(std::size_t unit, const FrameSlot& slot);

  VirtualTime::Actor actor_;
  Picture picture_;
  Taker taker_;
  std::vector<std::shared_ptr<KinectUnit>> units_;
  FramePool pool_;
  std::vector<std::unique_ptr<KinectSensor>> sensors_;
  std::vector<std::unique_ptr<SensorThread>> threads_;
  std::vector<Log> logs_;
  std::vector<std::uint16_t> raw_;
  std::vector<std::vector<std::uint16_t>> tables_;  // by unit
};

}  // namespace wagonsight::device
