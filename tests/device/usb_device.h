#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace wagonsight::device {

using Nanoseconds = std::int64_t;
constexpr Nanoseconds kMicroframe = 125'000;

// The device's end of a cable. Whoever stands at the other end sees to it that one thread at a time
// calls it.
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

}  // namespace wagonsight::device
