#pragma once

#include <memory>
#include <string>

#include "capture/clock_fit.h"
#include "capture/sensor.h"

namespace wagonsight {

struct KinectOptions {
  std::string name;    // of the sensor
  std::string device;  // its serial number, or the place where it is plugged in ("3-1.2")
  std::uint8_t sensor_index = 0;  // what its slots say
  // From the light to the earliest moment at which the host can have the frame.
  Duration light_to_arrival = std::chrono::milliseconds(33);
};

// A Kinect for Xbox 360: libfreenect over libusb, depth only, in millimetres by the camera's own
// optics, at 30 Hz.
//
// Opened, watched and brought back as capture/recovery.h draws it.
//
// The ladder: reopen; reset the device on the bus; cut the power of its port. Each attempt that
// does not bring frames waits twice as long, up to half a minute. Five seconds of frames end it.
//
// A frame with a lost packet is pushed as damaged, without depth, and counted; of one that got
// lost as a whole the next frame's timestamp tells. Nothing here waits longer than a few seconds,
// whatever the device does (see usb_guards.h). Our own code does not allocate once a frame flows;
// libusb does, and is exempt (linux/sealed_heap.h).
class KinectSensor final : public Sensor {
 public:
  explicit KinectSensor(KinectOptions options);
  ~KinectSensor() override;
  KinectSensor(const KinectSensor&) = delete;
  KinectSensor& operator=(const KinectSensor&) = delete;

  std::string_view name() const override;
  bool poll(Duration timeout, FramePool& pool, SpscRing<FrameSlot*>& frames) override;
  Counters counters() const override;
  std::string_view trouble() const override;

  // Of its quartz against the host's clock, as far as it is known.
  double drift_ppm() const;
  // What brought it back, since it was made.
  struct Ladder {
    std::uint64_t reopened = 0, bus_resets = 0, power_cycles = 0;
  };
  Ladder ladder() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace wagonsight
