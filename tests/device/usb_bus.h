#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "kernel_seam.h"

struct usbdevfs_urb;

// USB as libusb finds it on Linux: /sys/bus/usb/devices, /dev/bus/usb and udev's news. High speed:
// 8 packets a millisecond and endpoint. A packet that no transfer waits for is lost, as on a bus.
namespace wagonsight::device {

constexpr Nanoseconds kMicroframe = 125'000;

// The device's end of the cable. Called with VirtualTime's mutex held.
class UsbDevice {
 public:
  virtual ~UsbDevice() = default;

  struct Identity {
    std::uint16_t vendor = 0, product = 0, version = 0;
    std::string serial;
    int speed_mbit = 480;
  };
  virtual Identity identity() const = 0;
  // Device descriptor and configuration, as on the wire.
  virtual std::vector<std::uint8_t> descriptors() const = 0;

  struct Setup {
    std::uint8_t request_type = 0, request = 0;
    std::uint16_t value = 0, index = 0;
  };
  static constexpr int kNoAnswer = -1000;
  // The data stage's length, -errno, or kNoAnswer: it hangs until it is cancelled.
  virtual int control(const Setup& setup, std::span<std::uint8_t> data) = 0;
  struct IsoPacket {
    int length = 0;
    int status = 0;  // 0 or -errno
  };
  virtual IsoPacket isochronous(std::uint8_t endpoint, std::int64_t microframe,
                                std::span<std::uint8_t> out) = 0;
  // How much later than it was on the wire the host is told of a transfer that ends here.
  virtual Nanoseconds lateness(std::int64_t /*microframe*/) { return 0; }
  virtual void reset() {}        // by the bus
  virtual void power_cycle() {}  // of its port
};

// One emulated machine with some USB buses.
class UsbBuses {
 public:
  static UsbBuses& instance();

  // The device appears at a port of a bus's root hub, under a new address.
  void plug(std::shared_ptr<UsbDevice> device, int bus, int port);
  void unplug(int bus, int port);
  // Both with VirtualTime's mutex held, for scripts.
  void plug_locked(std::shared_ptr<UsbDevice> device, int bus, int port);
  void unplug_locked(int bus, int port);
  void unplug_everything();

  struct Counters {
    std::uint64_t resets = 0, port_cycles = 0;
  };
  Counters counters() const { return counters_; }
  // What the kernel lets transfers take together (usbfs_memory_mb); 0: no limit.
  void limit_memory(std::size_t bytes) { memory_max_ = bytes; }
  // A driver of the kernel's own that has taken each camera when it appears.
  void let_kernel_take_devices(bool it_does) { kernel_takes_ = it_does; }

  // ---- for the files and for udev
  struct Plugged {
    std::shared_ptr<UsbDevice> device;
    int bus = 0, port = 0, address = 0;
    bool present = true;
    bool kernel_driver = false;
    std::string sysfs_name() const;  // "3-1"
    std::string node() const;        // "/dev/bus/usb/003/002"
  };
  std::vector<std::shared_ptr<Plugged>> devices() const { return devices_; }
  std::shared_ptr<Plugged> find(const std::string& sysfs_name) const;
  struct News {
    std::string action, sysfs_name, node;
  };
  bool next_news(News& news);
  int news_fd();
  std::size_t memory_used = 0;
  std::size_t memory_max() const { return memory_max_; }
  void count_reset() { ++counters_.resets; }

 private:
  UsbBuses();
  Opened open_node(const std::string& path);
  Opened open_attribute(const std::string& path);
  void tell(const std::string& action, const Plugged& plugged);

  std::vector<std::shared_ptr<Plugged>> devices_;
  std::deque<News> news_;
  int news_fd_ = -1;
  std::map<int, int> last_address_;  // by bus
  std::size_t memory_max_ = 0;
  bool kernel_takes_ = false;
  Counters counters_;
};

}  // namespace wagonsight::device
