// What libusb asks of libudev, answered from the emulated buses: which USB devices there are, and
// news of those that come and go. Defined in the program, so these take the place of libudev's.

#include <linux/usbdevice_fs.h>

#include <cstdint>
#include <list>
#include <string>

#include <unistd.h>

#include "usb_bus.h"

using wagonsight::device::UsbBuses;
using wagonsight::device::VirtualTime;

// libudev's types are opaque to its users.
struct udev {};
struct udev_monitor {};
struct udev_list_entry {
  std::string path;
  udev_list_entry* next = nullptr;
};
struct udev_enumerate {
  std::list<udev_list_entry> entries;
};
struct udev_device {
  UsbBuses::News news;
};

namespace {
udev the_udev;
udev_monitor the_monitor;
constexpr std::string_view kDevices = "/sys/bus/usb/devices/";
}  // namespace

extern "C" {

udev* udev_new() {
  UsbBuses::instance();
  return &the_udev;
}
udev* udev_unref(udev* /*unused*/) {
  return nullptr;
}

udev_monitor* udev_monitor_new_from_netlink(udev* /*unused*/, const char* /*source*/) {
  return &the_monitor;
}
udev_monitor* udev_monitor_unref(udev_monitor* /*unused*/) {
  return nullptr;
}
int udev_monitor_filter_add_match_subsystem_devtype(udev_monitor* /*unused*/,
                                                    const char* /*subsystem*/,
                                                    const char* /*type*/) {
  return 0;
}
int udev_monitor_enable_receiving(udev_monitor* /*unused*/) {
  return 0;
}
int udev_monitor_get_fd(udev_monitor* /*unused*/) {
  return UsbBuses::instance().news_fd();
}
udev_device* udev_monitor_receive_device(udev_monitor* /*unused*/) {
  std::uint64_t count = 0;
  (void)!::read(UsbBuses::instance().news_fd(), &count, sizeof count);
  const std::lock_guard hold(VirtualTime::instance().mutex());
  UsbBuses::News news;
  return UsbBuses::instance().next_news(news) ? new udev_device{news} : nullptr;
}

udev_enumerate* udev_enumerate_new(udev* /*unused*/) {
  return new udev_enumerate;
}
udev_enumerate* udev_enumerate_unref(udev_enumerate* enumerate) {
  delete enumerate;
  return nullptr;
}
int udev_enumerate_add_match_subsystem(udev_enumerate* /*unused*/, const char* /*subsystem*/) {
  return 0;
}
int udev_enumerate_add_match_property(udev_enumerate* /*unused*/, const char* /*name*/,
                                      const char* /*value*/) {
  return 0;
}
int udev_enumerate_scan_devices(udev_enumerate* enumerate) {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  udev_list_entry* last = nullptr;
  for (const auto& plugged : UsbBuses::instance().devices()) {
    enumerate->entries.push_back({std::string(kDevices) + plugged->sysfs_name(), nullptr});
    if (last != nullptr) last->next = &enumerate->entries.back();
    last = &enumerate->entries.back();
  }
  return 0;
}
udev_list_entry* udev_enumerate_get_list_entry(udev_enumerate* enumerate) {
  return enumerate->entries.empty() ? nullptr : &enumerate->entries.front();
}
udev_list_entry* udev_list_entry_get_next(udev_list_entry* entry) {
  return entry->next;
}
const char* udev_list_entry_get_name(udev_list_entry* entry) {
  return entry->path.c_str();
}

udev_device* udev_device_new_from_syspath(udev* /*unused*/, const char* path) {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  const std::string name = std::string(path).substr(kDevices.size());
  const auto plugged = UsbBuses::instance().find(name);
  // A device that went away meanwhile has no node; libusb skips it.
  return new udev_device{{"", name, plugged ? plugged->node() : ""}};
}
udev_device* udev_device_unref(udev_device* device) {
  delete device;
  return nullptr;
}
const char* udev_device_get_devnode(udev_device* device) {
  return device->news.node.empty() ? nullptr : device->news.node.c_str();
}
const char* udev_device_get_sysname(udev_device* device) {
  return device->news.sysfs_name.c_str();
}
const char* udev_device_get_action(udev_device* device) {
  return device->news.action.empty() ? nullptr : device->news.action.c_str();
}

}  // extern "C"
