#pragma once

#include <string>

#include "base/result.h"

struct libusb_device;

// Where a device is plugged in, as the kernel names it, and what can be learned and done there
// without talking to the device, which may be wedged.
namespace wagonsight {

// "3-1.2": bus 3, port 1 of its root hub, port 2 of the hub there.
std::string usb_place(libusb_device* device);

// The serial number that the kernel read when the device was plugged in; empty when it has none.
std::string usb_serial(const std::string& place);

// Cuts the power of the port for a second, if its hub can (Linux 6.0 or later, and a hub that
// switches ports by themselves). Blocks for that second.
Result<void> cycle_port_power(const std::string& place);

}  // namespace wagonsight
