#include "vhci_ports.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>

namespace wagonsight::device::usbip {
namespace {

constexpr const char* kFolder = "/sys/devices/platform/vhci_hcd.0/";
constexpr int kFree = 4;       // VDEV_ST_NULL of drivers/usb/usbip/usbip_common.h
constexpr int kHighSpeed = 3;  // USB_SPEED_HIGH

std::string status_path(int controller) {
  return std::string(kFolder) + "status" +
         (controller == 0 ? "" : "." + std::to_string(controller));
}

}  // namespace

std::optional<int> free_port(std::string_view status, int avoided) {
  std::istringstream lines{std::string(status)};
  for (std::string line; std::getline(lines, line);) {
    int port = 0;
    int state = 0;
    if (std::sscanf(line.c_str(), "hs %d %d", &port, &state) == 2 && state == kFree &&
        port != avoided)
      return port;
  }
  return std::nullopt;
}

Result<int> plug_into_kernel(int controller, int descriptor, int avoided_port) {
  std::ifstream file(status_path(controller));
  const std::string status{std::istreambuf_iterator<char>(file), {}};
  const std::optional<int> port = free_port(status, avoided_port);
  if (!port)
    return fail(status_path(controller) +
                ": has no free port; load the module vhci-hcd, which has eight controllers");
  const std::string path = std::string(kFolder) + "attach";
  const int attach = open(path.c_str(), O_WRONLY | O_CLOEXEC);
  // The number of the device at its far end means nothing here.
  const std::string order = std::to_string(*port) + " " + std::to_string(descriptor) + " " +
                            std::to_string(1 << 16 | (*port + 2)) + " " +
                            std::to_string(kHighSpeed);
  const bool done = attach >= 0 &&
                    write(attach, order.data(), order.size()) == static_cast<ssize_t>(order.size());
  const int reason = errno;
  if (attach >= 0) close(attach);
  if (!done) return fail(path + ": " + std::strerror(reason));
  return *port;
}

}  // namespace wagonsight::device::usbip
