#pragma once

#include <libfreenect.h>
#include <libfreenect_registration.h>
#include <libusb.h>

#include <cstdint>
#include <span>
#include <string>

#include "base/time.h"
#include "kinect/depth_assembly.h"

// A Kinect that is found, opened, streams and is closed again, by libfreenect. Everything here may
// allocate and may take as long as it says. One thread. Internal to platform/kinect.
namespace wagonsight {

// Who is told of the stream, from within KinectDevice::process().
class KinectListener {
 public:
  virtual ~KinectListener() = default;
  // `ticks`: the camera's clock when the packet left it.
  virtual void packet(int number, std::uint32_t ticks, std::span<const std::byte> payload) = 0;
  // `ticks`: of the last packet of the frame that came.
  virtual void frame_end(std::uint32_t ticks) = 0;
};

inline constexpr double kKinectTicksPerSecond = 60e6;

class KinectDevice {
 public:
  explicit KinectDevice(KinectListener& listener) : listener_(listener) {}
  ~KinectDevice();
  KinectDevice(const KinectDevice&) = delete;
  KinectDevice& operator=(const KinectDevice&) = delete;

  // Each says what is wrong in a sentence that lives for ever, or nothing.
  using Trouble = const char*;

  // Opens the camera with this serial number or at this place and starts its depth. 3 s at most.
  Trouble open(const std::string& wanted);
  // Waits for packets; nothing or why the stream ended. `timeout` at most, and 0.3 s more when
  // the device was just unplugged.
  Trouble process(Duration timeout);
  // 0.3 s at most.
  void close();
  // Resets it on the bus; the kernel lets it take some seconds. False when that failed.
  bool reset(const std::string& wanted);

  // Whether the last open() found it.
  bool is_plugged() const { return is_plugged_; }
  const DepthTable& depth_table() const { return table_; }
  // Where it was found last; empty until then.
  const std::string& place() const { return place_; }
  // What is not good but does not keep it from working (it shares its bus), or nothing.
  Trouble remark() const { return remark_; }

 private:
  struct Found {
    libusb_device* device = nullptr;  // referenced
    int index = 0;                    // as libfreenect counts
    Trouble trouble = nullptr;
  };
  Trouble start_usb();
  Found find(const std::string& wanted);
  Trouble open_found(const Found& found, const std::string& wanted);
  Trouble read_optics();
  Trouble start_depth();

  KinectListener& listener_;
  libusb_context* usb_ = nullptr;
  freenect_context* context_ = nullptr;
  freenect_device* device_ = nullptr;
  DepthTable table_{};
  std::string place_;
  bool is_plugged_ = false;
  Trouble remark_ = nullptr;
};

}  // namespace wagonsight
