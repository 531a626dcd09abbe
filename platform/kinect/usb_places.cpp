#include "kinect/usb_places.h"

#include <fcntl.h>
#include <libusb.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <thread>

namespace wagonsight {
namespace {

constexpr std::string_view kDevices = "/sys/bus/usb/devices/";
constexpr int kDepthMax = 7;  // hubs below each other, by the USB specification
constexpr auto kWithoutPower = std::chrono::seconds(1);

Result<void> write_attribute(const std::string& path, std::string_view text) {
  const int fd = open(path.c_str(), O_WRONLY | O_CLOEXEC);
  const bool done =
      fd >= 0 && write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size());
  const int reason = errno;
  if (fd >= 0) close(fd);
  if (!done) return fail(path + ": " + std::strerror(reason));
  return {};
}

// The port's switch: HUB:1.0/HUB-portN/disable, where a root hub's folder is "B-0:1.0" and its
// ports are called after "usbB".
std::string port_switch(const std::string& place) {
  const auto last = place.find_last_of("-.");
  const std::string hub = place.substr(0, last);
  const std::string port = place.substr(last + 1);
  const bool is_root = place[last] == '-';
  const std::string folder = is_root ? hub + "-0:1.0" : hub + ":1.0";
  const std::string prefix = is_root ? "usb" + hub : hub;
  return std::string(kDevices) + folder + "/" + prefix + "-port" + port + "/disable";
}

}  // namespace

std::string usb_place(libusb_device* device) {
  std::array<std::uint8_t, kDepthMax> ports{};
  const int count = libusb_get_port_numbers(device, ports.data(), kDepthMax);
  std::string place = std::to_string(libusb_get_bus_number(device));
  for (int i = 0; i < count; ++i)
    place += (i == 0 ? "-" : ".") + std::to_string(ports[static_cast<std::size_t>(i)]);
  return place;
}

std::string usb_serial(const std::string& place) {
  const std::string path = std::string(kDevices) + place + "/serial";
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return {};
  std::array<char, 256> text{};
  const ssize_t count = read(fd, text.data(), text.size());
  close(fd);
  std::string serial(text.data(), static_cast<std::size_t>(std::max<ssize_t>(count, 0)));
  serial.erase(serial.find_last_not_of(" \n") + 1);
  return serial;
}

Result<void> cycle_port_power(const std::string& place) {
  const std::string path = port_switch(place);
  if (auto off = write_attribute(path, "1"); !off) return off;
  std::this_thread::sleep_for(kWithoutPower);
  return write_attribute(path, "0");
}

}  // namespace wagonsight
