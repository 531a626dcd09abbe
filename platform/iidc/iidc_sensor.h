#pragma once

#include <memory>
#include <string>

#include "capture/sensor.h"

namespace wagonsight {

enum class IidcTrigger {
  kFree,      // the camera's own rate
  kExternal,  // a pulse at its input
  kSoftware,  // a write that reaches all cameras of a bus at once (trigger_line.h)
};

struct IidcOptions {
  std::string name;               // of the sensor
  std::string device;             // its GUID: 16 hexadecimal digits
  std::uint8_t sensor_index = 0;  // what its slots say
  int width = 769, height = 448;  // of one image, as it was calibrated
  double rate_hz_max = 0;         // 0: as fast as its share of the bus allows
  IidcTrigger trigger = IidcTrigger::kFree;
  // From the end of the exposure to the first packet, which no clock tells.
  Duration readout{};
};

// A stereo camera on IEEE 1394 by the IIDC specification, with both images in one of twice the
// height or width, 16 bits a pixel: libdc1394 for its registers, the kernel's interface for its
// packets. Its slots are Gray16 pairs: the left image, then the right one.
//
// Opened, watched and brought back as capture/recovery.h draws it. A camera that is silent is
// initialised, one that does not answer has its bus reset (which costs its neighbours an image).
//
// An image is good when all of its packets came, one a cycle; a damaged one is pushed as such,
// without pixels, and counted. Images that got lost as a whole are told by the camera's own counter
// where it has one (by the clock where it runs freely). The instant is the middle of the exposure
// by the bus's clock: when the host heard of it does not matter. Nothing here waits longer than
// some seconds, whatever the camera does. Does not allocate once an image flows.
class IidcSensor final : public Sensor {
 public:
  explicit IidcSensor(IidcOptions options);
  ~IidcSensor() override;
  IidcSensor(const IidcSensor&) = delete;
  IidcSensor& operator=(const IidcSensor&) = delete;

  std::string_view name() const override;
  bool poll(Duration timeout, FramePool& pool, SpscRing<FrameSlot*>& frames) override;
  void set_exposure(const Exposure& exposure) override;
  Counters counters() const override;
  std::string_view trouble() const override;

  // Of the bus's clock against the host's, as far as it is known.
  double drift_ppm() const;
  double rate_hz_planned() const;
  // What brought it back, since it was made.
  struct Cures {
    std::uint64_t reopened = 0, initialised = 0, bus_resets = 0;
  };
  Cures cures() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace wagonsight
