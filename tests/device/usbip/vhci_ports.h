#pragma once

#include <optional>
#include <string_view>

#include "base/result.h"

// The kernel's end: ports of vhci_hcd's controllers, each of which is a USB bus of its own.
namespace wagonsight::device::usbip {

// The first free high-speed port in what a controller's `status` says, but not `avoided`.
std::optional<int> free_port(std::string_view status, int avoided = -1);

// Hands one end of a line to a free port of the controller, counted from 0, and returns the port.
// The kernel keeps the line by itself. Needs root.
Result<int> plug_into_kernel(int controller, int descriptor, int avoided_port = -1);

}  // namespace wagonsight::device::usbip
