#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "kernel_seam.h"
#include "usb_device.h"

struct usbdevfs_urb;

// USB as libusb finds it on Linux: /sys/bus/usb/devices, /dev/bus/usb and udev's news. High speed:
// 8 packets a millisecond and endpoint. A packet that no transfer waits for is lost, as on a bus.
// Devices are called with VirtualTime's mutex held.
namespace wagonsight::device {

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
