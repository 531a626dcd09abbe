#pragma once

#include <cstdint>

#include "base/time.h"

// What libfreenect does not do for itself, put between it and libusb. This program defines
// libusb_control_transfer and libusb_submit_transfer, which call libusb's own:
//
//  - libfreenect's requests have no timeout, so a wedged device would hold its thread for ever, and
//    it repeats a request for as long as the replies are empty. Here each ends after a second, and
//    all that one UsbPatience covers end together.
//  - libfreenect takes isochronous packets whose checksum was wrong for good ones. Here they count
//    as lost.
namespace wagonsight {

// All requests of the calling thread end within `limit` of its construction: those that come later
// fail at once. One at a time in a thread.
class UsbPatience {
 public:
  explicit UsbPatience(Duration limit);
  ~UsbPatience();
  UsbPatience(const UsbPatience&) = delete;
  UsbPatience& operator=(const UsbPatience&) = delete;

  // Whether a request had to be ended.
  bool is_spent() const;
};

// Isochronous packets of this process with a wrong checksum or another error of the bus.
std::uint64_t usb_packet_errors();

}  // namespace wagonsight
