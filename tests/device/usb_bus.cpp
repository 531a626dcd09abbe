#include "usb_bus.h"

#include <linux/usbdevice_fs.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace wagonsight::device {
namespace {

using Plugged = UsbBuses::Plugged;

constexpr std::string_view kNodes = "/dev/bus/usb/";
constexpr std::string_view kAttributes = "/sys/bus/usb/devices/";
constexpr std::size_t kSetupBytes = 8;

Nanoseconds now() {
  return VirtualTime::instance().now();
}

Opened text(std::string content) {
  return {nullptr, std::make_unique<std::string>(std::move(content)), 0};
}
Opened refuse(int error) {
  return {nullptr, nullptr, error};
}

// An open /dev/bus/usb/BBB/DDD.
class UsbFile final : public EmulatedFile {
 public:
  explicit UsbFile(std::shared_ptr<Plugged> plugged) : plugged_(std::move(plugged)) {}
  ~UsbFile() override {
    for (const Queued& queued : queue_) UsbBuses::instance().memory_used -= bytes_of(*queued.urb);
  }

  int ioctl(unsigned long request, void* argument) override;
  short events() override;
  Nanoseconds next_change() override;

 private:
  struct Queued {
    usbdevfs_urb* urb = nullptr;
    std::int64_t first_microframe = 0;
    Nanoseconds due = 0;
    int cancelled = 0;  // -errno once it is
  };

  static std::size_t bytes_of(const usbdevfs_urb& urb) {
    return static_cast<std::size_t>(urb.buffer_length);
  }
  int submit(usbdevfs_urb& urb);
  void queue_isochronous(usbdevfs_urb& urb);
  int discard(const usbdevfs_urb* urb);
  int reap(usbdevfs_urb** out);
  void fill_isochronous(const Queued& queued);
  int claim();
  int disconnect_or_connect(const usbdevfs_ioctl& command);

  std::shared_ptr<Plugged> plugged_;
  std::deque<Queued> queue_;
  struct Endpoint {
    std::int64_t next_microframe = 0;
    Nanoseconds last_due = 0;
  };
  std::map<unsigned, Endpoint> endpoints_;
};

int UsbFile::ioctl(unsigned long request, void* argument) {
  if (request == USBDEVFS_REAPURBNDELAY) return reap(static_cast<usbdevfs_urb**>(argument));
  if (!plugged_->present) return -ENODEV;
  switch (request) {
    case USBDEVFS_GET_CAPABILITIES:
      *static_cast<std::uint32_t*>(argument) = USBDEVFS_CAP_ZERO_PACKET |
                                               USBDEVFS_CAP_NO_PACKET_SIZE_LIM |
                                               USBDEVFS_CAP_REAP_AFTER_DISCONNECT;
      return 0;
    case USBDEVFS_CLAIMINTERFACE:
      return claim();
    case USBDEVFS_GETDRIVER:
      if (!plugged_->kernel_driver) return -ENODATA;
      std::strcpy(static_cast<usbdevfs_getdriver*>(argument)->driver, "gspca_kinect");
      return 0;
    case USBDEVFS_IOCTL:
      return disconnect_or_connect(*static_cast<usbdevfs_ioctl*>(argument));
    case USBDEVFS_RELEASEINTERFACE:
    case USBDEVFS_SETINTERFACE:
    case USBDEVFS_SETCONFIGURATION:
    case USBDEVFS_CLEAR_HALT:
      return 0;
    case USBDEVFS_RESET:
      UsbBuses::instance().count_reset();
      plugged_->device->reset();
      return 0;
    case USBDEVFS_SUBMITURB:
      return submit(*static_cast<usbdevfs_urb*>(argument));
    case USBDEVFS_DISCARDURB:
      return discard(static_cast<const usbdevfs_urb*>(argument));
    default:
      return -ENOTTY;
  }
}

int UsbFile::claim() {
  return plugged_->kernel_driver ? -EBUSY : 0;
}

int UsbFile::disconnect_or_connect(const usbdevfs_ioctl& command) {
  if (command.ioctl_code == static_cast<int>(USBDEVFS_DISCONNECT)) plugged_->kernel_driver = false;
  return command.ioctl_code == static_cast<int>(USBDEVFS_CONNECT) ? 1 : 0;
}

short UsbFile::events() {
  const bool some_done = std::any_of(queue_.begin(), queue_.end(), [&](const Queued& queued) {
    return queued.cancelled != 0 || queued.due <= now() || !plugged_->present;
  });
  return static_cast<short>((some_done ? POLLOUT : 0) |
                            (plugged_->present ? 0 : POLLERR | POLLHUP));
}

Nanoseconds UsbFile::next_change() {
  Nanoseconds next = VirtualTime::kNever;
  for (const Queued& queued : queue_) next = std::min(next, queued.due);
  return next;
}

int UsbFile::submit(usbdevfs_urb& urb) {
  UsbBuses& buses = UsbBuses::instance();
  if (buses.memory_max() != 0 && buses.memory_used + bytes_of(urb) > buses.memory_max())
    return -ENOMEM;
  urb.status = -EINPROGRESS;
  urb.actual_length = 0;
  urb.error_count = 0;
  if (urb.type == USBDEVFS_URB_TYPE_ISO) {
    queue_isochronous(urb);
  } else if (urb.type == USBDEVFS_URB_TYPE_CONTROL) {
    const auto* bytes = static_cast<std::uint8_t*>(urb.buffer);
    const auto word = [&](int at) {
      return static_cast<std::uint16_t>(bytes[at] | bytes[at + 1] << 8);
    };
    const std::span data(static_cast<std::uint8_t*>(urb.buffer) + kSetupBytes, word(6));
    const int answer = plugged_->device->control({bytes[0], bytes[1], word(2), word(4)}, data);
    urb.status = std::min(answer, 0);
    urb.actual_length = std::max(answer, 0);
    const bool hangs = answer == UsbDevice::kNoAnswer;
    queue_.push_back({&urb, 0, hangs ? VirtualTime::kNever : now() + kMicroframe, 0});
  } else {
    return -EINVAL;
  }
  buses.memory_used += bytes_of(urb);
  return 0;
}

void UsbFile::queue_isochronous(usbdevfs_urb& urb) {
  Endpoint& endpoint = endpoints_[urb.endpoint];
  const std::int64_t earliest = now() / kMicroframe + 1;
  const std::int64_t first = std::max(endpoint.next_microframe, earliest);
  const std::int64_t end = first + urb.number_of_packets;
  const Nanoseconds due = end * kMicroframe + plugged_->device->lateness(end);
  endpoint.next_microframe = end;
  endpoint.last_due = std::max(endpoint.last_due, due);
  queue_.push_back({&urb, first, endpoint.last_due, 0});
}

int UsbFile::discard(const usbdevfs_urb* urb) {
  for (Queued& queued : queue_) {
    if (queued.urb != urb || queued.cancelled != 0) continue;
    queued.cancelled = -ENOENT;
    return 0;
  }
  return -EINVAL;
}

int UsbFile::reap(usbdevfs_urb** out) {
  const auto done = [&](const Queued& queued) {
    return queued.cancelled != 0 || queued.due <= now() || !plugged_->present;
  };
  const auto found = std::find_if(queue_.begin(), queue_.end(), done);
  if (found == queue_.end()) return plugged_->present ? -EAGAIN : -ENODEV;
  const Queued queued = *found;
  queue_.erase(found);
  UsbBuses::instance().memory_used -= bytes_of(*queued.urb);
  const bool came = queued.due <= now();
  if (queued.urb->type == USBDEVFS_URB_TYPE_ISO && came && plugged_->present) {
    fill_isochronous(queued);
    queued.urb->status = 0;
  } else if (!came || !plugged_->present) {
    queued.urb->status = plugged_->present ? queued.cancelled : -ESHUTDOWN;
    queued.urb->actual_length = 0;
    for (int i = 0; i < queued.urb->number_of_packets && queued.urb->type == USBDEVFS_URB_TYPE_ISO;
         ++i)
      queued.urb->iso_frame_desc[i].actual_length = 0;
  }
  *out = queued.urb;
  return 0;
}

void UsbFile::fill_isochronous(const Queued& queued) {
  usbdevfs_urb& urb = *queued.urb;
  auto* place = static_cast<std::uint8_t*>(urb.buffer);
  for (int i = 0; i < urb.number_of_packets; ++i) {
    auto& described = urb.iso_frame_desc[i];
    const UsbDevice::IsoPacket packet = plugged_->device->isochronous(
        urb.endpoint, queued.first_microframe + i, {place, described.length});
    described.actual_length = static_cast<unsigned>(packet.length);
    described.status = static_cast<unsigned>(packet.status);
    urb.actual_length += packet.length;
    urb.error_count += packet.status == 0 ? 0 : 1;
    place += described.length;
  }
}

// .../usbB-portP/disable: writing 1 cuts the port's power, 0 gives it back.
class PortSwitch final : public EmulatedFile {
 public:
  explicit PortSwitch(std::function<void()> cycle) : cycle_(std::move(cycle)) {}
  ssize_t write(const void* bytes, std::size_t count) override {
    if (count > 0 && *static_cast<const char*>(bytes) == '0') cycle_();
    return static_cast<ssize_t>(count);
  }

 private:
  std::function<void()> cycle_;
};

std::string root_hub_descriptors() {
  const unsigned char bytes[] = {
      18, 1, 0,  2, 9, 0, 1, 64,   0x6b, 0x1d, 2, 0, 0, 6, 0, 0, 0, 1,  // one configuration:
      9,  2, 25, 0, 1, 1, 0, 0xe0, 0,    9,    4, 0, 0, 1, 9, 0, 0, 0, 7, 5, 0x81, 3, 4, 0, 12};
  return {reinterpret_cast<const char*>(bytes), sizeof bytes};
}

}  // namespace

std::string UsbBuses::Plugged::sysfs_name() const {
  return std::to_string(bus) + "-" + std::to_string(port);
}

UsbBuses& UsbBuses::instance() {
  static auto* buses = new UsbBuses;
  return *buses;
}

UsbBuses::UsbBuses() : news_fd_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK | EFD_SEMAPHORE)) {
  serve_paths(std::string(kNodes), [this](const std::string& path) { return open_node(path); });
  serve_paths(std::string(kAttributes),
              [this](const std::string& path) { return open_attribute(path); });
}

void UsbBuses::plug(std::shared_ptr<UsbDevice> device, int bus, int port) {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  plug_locked(std::move(device), bus, port);
}
void UsbBuses::unplug(int bus, int port) {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  unplug_locked(bus, port);
}

void UsbBuses::plug_locked(std::shared_ptr<UsbDevice> device, int bus, int port) {
  auto plugged = std::make_shared<Plugged>();
  plugged->device = std::move(device);
  plugged->bus = bus;
  plugged->port = port;
  plugged->address = ++last_address_.try_emplace(bus, 1).first->second;
  plugged->kernel_driver = kernel_takes_;
  devices_.push_back(plugged);
  tell("add", *plugged);
}

void UsbBuses::unplug_locked(int bus, int port) {
  const auto found = std::find_if(devices_.begin(), devices_.end(), [&](const auto& plugged) {
    return plugged->bus == bus && plugged->port == port;
  });
  if (found == devices_.end()) return;
  (*found)->present = false;
  tell("remove", **found);
  devices_.erase(found);
  VirtualTime::instance().something_changed();
}

void UsbBuses::unplug_everything() {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  while (!devices_.empty()) unplug_locked(devices_.back()->bus, devices_.back()->port);
  counters_ = {};
  memory_max_ = 0;
  kernel_takes_ = false;
}

std::shared_ptr<Plugged> UsbBuses::find(const std::string& sysfs_name) const {
  for (const auto& plugged : devices_)
    if (plugged->sysfs_name() == sysfs_name) return plugged;
  return nullptr;
}

std::string UsbBuses::Plugged::node() const {
  std::array<char, 32> path{};
  std::snprintf(path.data(), path.size(), "/dev/bus/usb/%03d/%03d", bus, address);
  return path.data();
}

void UsbBuses::tell(const std::string& action, const Plugged& plugged) {
  news_.push_back({action, plugged.sysfs_name(), plugged.node()});
  eventfd_write(news_fd_, 1);  // not write(), which is the seam's and wants the mutex
}

bool UsbBuses::next_news(News& news) {
  if (news_.empty()) return false;
  news = news_.front();
  news_.pop_front();
  return true;
}

int UsbBuses::news_fd() {
  return news_fd_;
}

Opened UsbBuses::open_node(const std::string& path) {
  for (const auto& plugged : devices_)
    if (plugged->node() == path) return {std::make_shared<UsbFile>(plugged), nullptr, 0};
  return refuse(-ENOENT);
}

Opened UsbBuses::open_attribute(const std::string& path) {
  const std::string below = path.substr(kAttributes.size());
  const auto slash = below.find('/');
  const std::string device = below.substr(0, slash);
  const std::string attribute = slash == std::string::npos ? "" : below.substr(slash + 1);
  int bus = 0;
  int port = 0;
  if (std::sscanf(below.c_str(), "%d-0:1.0/usb%*d-port%d/disable", &bus, &port) == 2) {
    return {std::make_shared<PortSwitch>([this, bus, port] {
              ++counters_.port_cycles;
              const auto plugged = find(std::to_string(bus) + "-" + std::to_string(port));
              if (!plugged) return;
              const auto what = plugged->device;
              unplug_locked(bus, port);
              what->power_cycle();
              plug_locked(what, bus, port);
            }),
            nullptr, 0};
  }
  if (std::sscanf(device.c_str(), "usb%d", &bus) == 1) {
    if (attribute == "descriptors") return text(root_hub_descriptors());
    if (attribute == "busnum") return text(std::to_string(bus) + "\n");
    if (attribute == "speed") return text("480\n");
    if (attribute == "devnum" || attribute == "bConfigurationValue") return text("1\n");
    return refuse(-ENOENT);
  }
  const auto plugged = find(device);
  if (!plugged) return refuse(-ENOENT);
  const UsbDevice::Identity identity = plugged->device->identity();
  if (attribute == "busnum") return text(std::to_string(plugged->bus) + "\n");
  if (attribute == "devnum") return text(std::to_string(plugged->address) + "\n");
  if (attribute == "speed") return text(std::to_string(identity.speed_mbit) + "\n");
  if (attribute == "serial" && !identity.serial.empty()) return text(identity.serial + "\n");
  if (attribute == "bConfigurationValue") return text("1\n");
  if (attribute == "descriptors") {
    const auto bytes = plugged->device->descriptors();
    return text({bytes.begin(), bytes.end()});
  }
  return refuse(-ENOENT);
}

}  // namespace wagonsight::device
