#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/time.h"
#include "capture/sensor.h"
#include "frame/frame.h"
#include "simulate/kinect_model.h"
#include "simulate/scene.h"
#include "simulate/stereo_model.h"
#include "simulate/world.h"
#include "snapshot/snapshot.h"

namespace wagonsight {

// When a frame of a sensor was taken and when the host has it, by the sensor's own clock and the
// scene's faults.
struct FrameTiming {
  std::uint32_t sequence = 0;      // counts frames that were lost, too
  std::uint64_t device_ticks = 0;  // 60 MHz, by the sensor's drifting clock
  HostTime instant{};              // when the light was taken: the truth
  HostTime stamp{};                // what a driver says of it: later by the sensor's stamp_late_s
  HostTime arrival{};              // when the host has the whole frame
  bool lost = false;               // never arrives
};

inline constexpr double kTicksPerSecond = 60e6;

// The frames of one sensor, one after the other; deterministic by scene and seed.
class FrameClock {
 public:
  FrameClock(const Scene& scene, std::size_t sensor, std::uint64_t seed);
  FrameTiming next();

 private:
  const Scene* scene_;
  std::size_t sensor_;
  std::uint64_t seed_;
  std::uint64_t ticks_at_start_;
  std::uint32_t sequence_ = 0;
  HostTime last_arrival_{};
};

// One sensor of a scene with a world of its own: give it time and it gives frames. Allocates only
// when made. One thread.
class SimulatedDevice {
 public:
  SimulatedDevice(const Scene& scene, std::size_t sensor, std::uint64_t seed);

  // The timing of the frame that next() would deliver; frames that are lost are passed over.
  const FrameTiming& upcoming() const { return upcoming_; }
  std::uint64_t lost_count() const { return lost_; }
  // Renders the upcoming frame into the slot (format, size, times, pixels) and goes on to the one
  // after it. The slot needs slot_bytes().
  void next(FrameSlot& slot);
  // Goes on without rendering: nobody has memory for the frame.
  void skip();

  std::size_t slot_bytes() const;
  // For the frames that are taken from now on; a Kinect takes no notice.
  void set_exposure(const Exposure& exposure);

  // Exactly one of them is there.
  const KinectModel* kinect() const { return kinect_.get(); }
  StereoModel* stereo() { return stereo_.get(); }
  World& world() { return world_; }

 private:
  void advance();

  std::size_t sensor_;
  World world_;
  std::unique_ptr<KinectModel> kinect_;
  std::unique_ptr<StereoModel> stereo_;
  Exposure exposure_ = StereoModel::kFirstExposure;
  FrameClock clock_;
  FrameTiming upcoming_;
  std::uint64_t lost_ = 0;
};

// All sensors of a scene and its truth, in virtual time: frames come in the order of their arrival.
// The same scene and seed give the same bytes every time. One thread.
class Simulation {
 public:
  Simulation(const Scene& scene, std::uint64_t seed);

  const Scene& scene() const { return scene_; }
  std::size_t sensor_count() const { return devices_.size(); }
  // The timing of the next frame to arrive, and whose it is. Needs at least one sensor.
  const FrameTiming& upcoming(std::size_t& sensor) const;
  // Renders the next frame to arrive.
  void next(FrameSlot& slot);
  SimulatedDevice& device(std::size_t sensor) { return *devices_[sensor]; }

  // Instants must not lie more than a second behind the latest one asked for.
  void truth_at(HostTime instant, PeopleFrame& truth) { world_.truth_at(instant, truth); }

 private:
  Scene scene_;
  World world_;
  std::vector<std::unique_ptr<SimulatedDevice>> devices_;
};

// How a simulated sensor waits: the demo's pace follows the unit's clock, a replay's does not wait.
// The scene begins at `start` of that clock.
class Pace {
 public:
  virtual ~Pace() = default;
  // Waits until `when` or for `timeout`, whichever comes first; true when `when` has come.
  virtual bool wait_until(HostTime when, Duration timeout) = 0;
  // How far `when` has passed. A sensor that is further behind than a device could buffer drops
  // frames until it has caught up; a replay is never behind.
  virtual Duration behind([[maybe_unused]] HostTime when) const { return Duration::zero(); }
};

// A sensor of a scene in the form of a driver. Frames carry host times that begin at `start`.
class SimulatedSensor final : public Sensor {
 public:
  // `pace` must outlive the sensor. Ends (poll gives false) at `end` of virtual time.
  SimulatedSensor(const Scene& scene, std::size_t sensor, std::uint64_t seed, Pace& pace,
                  HostTime start, Duration end = Duration::max());

  std::string_view name() const override { return name_; }
  bool poll(Duration timeout, FramePool& pool, SpscRing<FrameSlot*>& frames) override;
  Counters counters() const override { return counters_; }
  void set_exposure(const Exposure& exposure) override {
    wanted_exposure_.store(exposure, std::memory_order_relaxed);
  }

 private:
  Scene scene_;
  std::string name_;
  SimulatedDevice device_;
  std::atomic<Exposure> wanted_exposure_{Exposure{}};
  Pace* pace_;
  HostTime start_;
  Duration end_;
  Counters counters_;
};

}  // namespace wagonsight
