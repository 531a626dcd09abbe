#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <thread>
#include <vector>

#include "usb_device.h"
#include "usbip_wire.h"

namespace wagonsight::device::usbip {

// The cable between an emulated device and the kernel's vhci_hcd: answers what comes from a socket,
// in the host's time, in a thread of its own. Isochronous transfers are given the microframes
// that follow each other, eight a millisecond, and are answered when the last of them has passed; a
// packet that no transfer waits for is lost, as on a bus.
class UsbipLine {
 public:
  // Takes over the descriptor. `device` must outlive this; it is called with `device_mutex` held.
  UsbipLine(UsbDevice& device, std::mutex& device_mutex, int descriptor);
  // Pulls the plug.
  ~UsbipLine();
  UsbipLine(const UsbipLine&) = delete;
  UsbipLine& operator=(const UsbipLine&) = delete;

  // Whether the kernel still holds the other end.
  bool is_up() const { return is_up_; }

 private:
  struct Pending {
    Request request;
    std::vector<PacketDescription> packets;
    std::int64_t first_microframe = 0;
    Nanoseconds due = 0;
  };

  void serve();
  bool wait_for_request();
  bool take_request();
  void queue(const Request& request, std::vector<PacketDescription> packets);
  void unlink(const Request& request);
  void answer_control(const Request& request);
  void answer_isochronous(Pending& pending);
  void answer_due();
  bool receive(std::span<std::uint8_t> bytes);
  void send(std::span<const std::uint8_t> bytes);

  UsbDevice& device_;
  std::mutex& device_mutex_;
  int descriptor_;
  std::deque<Pending> pending_;
  struct Endpoint {
    std::int64_t next_microframe = 0;
    Nanoseconds last_due = 0;
  };
  std::map<std::uint8_t, Endpoint> endpoints_;
  std::vector<std::uint8_t> taken_, answer_;
  std::atomic<bool> is_up_{true};
  std::thread thread_;
};

// What every USB device answers by itself: its descriptors, its configuration. Others' requests are
// the device's own. The data stage's length, -errno, or UsbDevice::kNoAnswer.
int answer_request(UsbDevice& device, const UsbDevice::Setup& setup, std::span<std::uint8_t> data);

}  // namespace wagonsight::device::usbip
