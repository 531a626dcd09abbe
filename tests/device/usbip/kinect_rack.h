#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "base/result.h"
#include "kinect_unit.h"
#include "usbip_line.h"

namespace wagonsight::device::usbip {

// Kinects in the kernel's USB ports, each on a bus of its own. Each looks at a still picture whose
// every pixel flickers by one step of disparity, like a real one's, so that any two of its pictures
// in a row differ all over, and every pixel of every frame is known.
class KinectRack {
 public:
  // `stills`: a recording with a depth image of each Kinect, which are named and ordered as there.
  static Result<std::unique_ptr<KinectRack>> open(const std::string& stills);

  std::size_t size() const { return kinects_.size(); }
  const std::string& name(std::size_t index) const { return kinects_[index].name; }
  const std::string& serial(std::size_t index) const { return kinects_[index].serial; }

  // Into a port of its bus, another one than last time.
  Result<void> plug(std::size_t index);
  void unplug(std::size_t index) { kinects_[index].line.reset(); }

  // Changes what is wrong with one.
  void spoil(std::size_t index, const std::function<void(KinectFaults& faults)>& change);

  // Of the frames that began on the wire so far: those that the kernel fetched every packet of, and
  // those it did not. The one that is under way counts as neither.
  struct Sent {
    std::uint64_t whole = 0, torn = 0;
  };
  Sent sent(std::size_t index);

  // Every pixel of every frame of a recording that was made in the last minute.
  struct Comparison {
    std::uint64_t frames = 0, pixels = 0, wrong_pixels = 0;
    std::uint64_t missing = 0;  // between frames of the same Kinect
    void add(const Comparison& other);
  };
  Result<Comparison> compare(const std::string& recording);

 private:
  struct Kinect {
    std::string name, serial;
    std::vector<std::uint16_t> still;  // raw disparities
    std::unique_ptr<KinectUnit> unit;
    std::vector<std::uint16_t> millimetres;  // by raw disparity
    int port = -1;
    std::unique_ptr<UsbipLine> line;
  };

  KinectRack() = default;
  void add(const std::string& name, std::span<const std::uint16_t> still_mm);

  std::mutex mutex_;  // of the units
  std::vector<Kinect> kinects_;
};

// Serial number of the Kinect at this place of the rack.
std::string rack_serial(std::size_t index);

}  // namespace wagonsight::device::usbip
