#pragma once

#include <dc1394/dc1394.h>

#include <cstdint>
#include <string>

#include "base/time.h"
#include "frame/frame.h"
#include "iidc/fire_nodes.h"
#include "iidc/iidc_sensor.h"
#include "iidc/iso_receiver.h"
#include "iidc/packet_plan.h"
#include "iidc/pair_assembly.h"

namespace wagonsight {

struct IidcWish {
  std::uint64_t guid = 0;
  int width = 0, height = 0;  // of one image
  double rate_hz_max = 0;     // 0: as fast as the bus allows
  IidcTrigger trigger = IidcTrigger::kFree;
};

// An IIDC stereo camera that is found, set up, streams and is closed again: libdc1394 for its
// registers, IsoReceiver for its images. Everything here may allocate and take as long as it says:
// each request to a camera that does not answer takes the kernel two seconds, and then no other is
// made. One thread. Internal to platform/iidc.
class IidcDevice {
 public:
  explicit IidcDevice(IsoListener& listener) : listener_(listener) {}
  ~IidcDevice() { close(); }
  IidcDevice(const IidcDevice&) = delete;
  IidcDevice& operator=(const IidcDevice&) = delete;

  // Each says what is wrong in a sentence that lives for ever, or nothing.
  using Trouble = const char*;

  enum class Cure { kNone, kInitialise, kBusReset };
  // Finds the camera, applies the cure, sets it up and starts its stream. 5 s at most.
  Trouble open(const IidcWish& wish, Cure cure);
  Trouble wait(Duration timeout) { return receiver_.wait(timeout, listener_); }
  Trouble flush() { return receiver_.flush(listener_); }
  IsoReceiver::Clocks read_clocks() const { return receiver_.read_clocks(); }
  // `is_answering` false: without asking it to stop.
  void close(bool is_answering = true);

  // Shutter and gain of the next images. Takes no notice where the camera has no such units. False:
  // it does not answer. Does not allocate.
  bool set_exposure(const Exposure& wanted);
  // What it was told last; zeros: it cannot be told.
  const Exposure& exposure() const { return exposure_; }

  bool is_plugged() const { return is_plugged_; }
  // Whether it did not answer, or refused, the last time it was asked.
  bool is_mute() const { return is_mute_; }
  // What is not good but does not keep it from working, or nothing.
  Trouble remark() const { return remark_; }
  const PairShape& shape() const { return shape_; }
  const PacketPlan& plan() const { return plan_; }
  // Whether each image's first four bytes are a counter.
  bool counts_images() const { return counts_images_; }

 private:
  struct Limits {
    float low = 0, high = 0;
  };
  Trouble find(const IidcWish& wish, FireNode& node);
  Trouble set_up(const IidcWish& wish);
  Trouble set_format(const IidcWish& wish);
  Trouble take_format();
  Trouble set_packets(const IidcWish& wish);
  Trouble set_trigger(IidcTrigger trigger);
  Trouble set_features();
  void count_images();
  bool take_absolute(dc1394feature_t feature, Limits& limits);

  IsoListener& listener_;
  dc1394_t* library_ = nullptr;
  dc1394camera_t* camera_ = nullptr;
  IsoReceiver receiver_;
  int cameras_on_bus_ = 1;
  bool is_plugged_ = false, is_mute_ = false, counts_images_ = false;
  Trouble remark_ = nullptr;
  PairShape shape_;
  PacketPlan plan_;
  Exposure exposure_{};
  Limits shutter_s_{}, gain_db_{};
  bool has_gain_ = false;
};

}  // namespace wagonsight
