#include "kinect/kinect_device.h"

#include <algorithm>
#include <cstring>
#include <string_view>

#include "kinect/usb_guards.h"
#include "kinect/usb_places.h"
#include "linux/sealed_heap.h"

namespace wagonsight {
namespace {

constexpr std::uint16_t kMicrosoft = 0x045e;
constexpr std::uint16_t kCameras[] = {0x02ae, 0x02bf};  // Xbox 360, Windows
constexpr Duration kOpenMax = std::chrono::seconds(3);
constexpr Duration kCloseMax = std::chrono::milliseconds(300);

constexpr auto kNoUsb = "USB cannot be used; check that /dev/bus/usb is there and may be read";
constexpr auto kAbsent =
    "no Kinect with this serial number or at this place is plugged in; check its power supply and "
    "its cable, and compare with `wagonsight devices`";
constexpr auto kTooSlow =
    "the Kinect is connected at less than 480 Mbit/s, too slow for depth; use another port or "
    "cable";
constexpr auto kSharesBus = "another Kinect is on the same USB bus; give each its own controller";
constexpr auto kForbidden =
    "the Kinect may not be opened; give the service's user access to /dev/bus/usb (udev rule)";
constexpr auto kNotOpened =
    "the Kinect cannot be opened; another program or a kernel driver (gspca_kinect) may hold it";
constexpr auto kSilentRequests = "the Kinect does not answer; it is being reset";
constexpr auto kWrongReplies =
    "the Kinect answers wrongly; it is being reset, and if that lasts check its cable";
constexpr auto kNoOptics =
    "the Kinect tells optics that no Kinect has; reset it, and if that lasts replace it";
constexpr auto kNoStream =
    "the Kinect's stream cannot start; raise usbcore.usbfs_memory_mb or use another USB controller";
constexpr auto kUnplugged = "the Kinect was unplugged or lost its power; check plug and supply";

// libfreenect hands out a packet's payload where it came in, behind the header of 12 bytes that
// ends with the camera's clock; it tells the clock of a frame's last packet only.
std::uint32_t ticks_before(const std::byte* payload) {
  std::uint32_t ticks = 0;
  std::memcpy(&ticks, payload - sizeof ticks, sizeof ticks);
  return ticks;
}

bool is_camera(const libusb_device_descriptor& descriptor) {
  return descriptor.idVendor == kMicrosoft && std::find(std::begin(kCameras), std::end(kCameras),
                                                        descriptor.idProduct) != std::end(kCameras);
}

// libfreenect tells of a transfer that was refused only in its log.
thread_local bool transfers_refused = false;
void read_log(freenect_context* /*context*/, freenect_loglevel /*level*/, const char* text) {
  if (std::string_view(text).find("submit isochronous") != std::string_view::npos)
    transfers_refused = true;
}

// The cameras that are plugged in, in libusb's order, which is libfreenect's.
class CameraList {
 public:
  explicit CameraList(libusb_context* usb) : count_(libusb_get_device_list(usb, &devices_)) {}
  ~CameraList() {
    if (count_ >= 0) libusb_free_device_list(devices_, 1);
  }
  CameraList(const CameraList&) = delete;
  CameraList& operator=(const CameraList&) = delete;

  template <class F>
  void each(F visit) const {
    int index = 0;
    for (ssize_t i = 0; i < count_; ++i) {
      libusb_device_descriptor descriptor{};
      if (libusb_get_device_descriptor(devices_[i], &descriptor) == 0 && is_camera(descriptor))
        visit(devices_[i], index++);
    }
  }

 private:
  libusb_device** devices_ = nullptr;
  ssize_t count_;
};

}  // namespace

KinectDevice::~KinectDevice() {
  close();
  if (usb_ != nullptr) libusb_exit(usb_);
}

KinectDevice::Trouble KinectDevice::start_usb() {
  if (usb_ != nullptr || libusb_init(&usb_) == 0) return nullptr;
  usb_ = nullptr;
  return kNoUsb;
}

KinectDevice::Found KinectDevice::find(const std::string& wanted) {
  Found found;
  const CameraList cameras(usb_);
  cameras.each([&](libusb_device* device, int index) {
    const std::string place = usb_place(device);
    if (found.device != nullptr || (wanted != place && wanted != usb_serial(place))) return;
    found = {libusb_ref_device(device), index, nullptr};
    place_ = place;
  });
  if (found.device == nullptr) return {nullptr, 0, kAbsent};
  int on_bus = 0;
  cameras.each([&](libusb_device* device, int /*index*/) {
    if (libusb_get_bus_number(device) == libusb_get_bus_number(found.device)) ++on_bus;
  });
  remark_ = on_bus > 1 ? kSharesBus : nullptr;
  if (libusb_get_device_speed(found.device) < LIBUSB_SPEED_HIGH) found.trouble = kTooSlow;
  return found;
}

KinectDevice::Trouble KinectDevice::open(const std::string& wanted) {
  is_plugged_ = false;
  const UsbPatience patience(kOpenMax);
  if (const Trouble trouble = start_usb()) return trouble;
  const Found found = find(wanted);
  is_plugged_ = found.device != nullptr;
  if (!is_plugged_) return found.trouble;
  Trouble trouble = found.trouble;
  if (trouble == nullptr) trouble = open_found(found, wanted);
  libusb_unref_device(found.device);
  if (trouble == nullptr) trouble = read_optics();
  if (trouble == nullptr) trouble = start_depth();
  if (trouble != nullptr && patience.is_spent()) trouble = kSilentRequests;
  if (trouble != nullptr) close();
  return trouble;
}

KinectDevice::Trouble KinectDevice::open_found(const Found& found, const std::string& wanted) {
  libusb_device_handle* handle = nullptr;
  const int opened = libusb_open(found.device, &handle);
  if (opened == LIBUSB_ERROR_ACCESS) return kForbidden;
  if (opened == LIBUSB_ERROR_NO_DEVICE) return kAbsent;
  if (opened != 0) return kNotOpened;
  libusb_close(handle);
  if (freenect_init(&context_, usb_) < 0) return kNoUsb;
  freenect_set_log_callback(context_, read_log);
  freenect_select_subdevices(context_, FREENECT_DEVICE_CAMERA);
  freenect_device* device = nullptr;
  const int failed = freenect_open_device(context_, &device, found.index);
  // Devices come and go: is the one at this index still the one that was meant?
  const Found again = find(wanted);
  const bool is_same = again.device == found.device && again.index == found.index;
  if (again.device != nullptr) libusb_unref_device(again.device);
  if (!is_same) return kAbsent;
  if (failed < 0) return device == nullptr ? kNotOpened : kWrongReplies;
  device_ = device;
  return nullptr;
}

KinectDevice::Trouble KinectDevice::read_optics() {
  freenect_registration known = freenect_copy_registration(device_);
  const freenect_zero_plane_info& plane = known.zero_plane_info;
  const bool is_good = make_depth_table(
      {static_cast<double>(plane.dcmos_emitter_dist), static_cast<double>(plane.reference_distance),
       static_cast<double>(plane.reference_pixel_size), known.const_shift},
      table_);
  freenect_destroy_registration(&known);
  return is_good ? nullptr : kNoOptics;
}

KinectDevice::Trouble KinectDevice::start_depth() {
  transfers_refused = false;
  freenect_set_user(device_, &listener_);
  const auto mode =
      freenect_find_depth_mode(FREENECT_RESOLUTION_MEDIUM, FREENECT_DEPTH_11BIT_PACKED);
  if (freenect_set_depth_mode(device_, mode) < 0) return kNotOpened;
  freenect_set_depth_chunk_callback(
      device_, [](void* /*buffer*/, void* bytes, int number, int count, void* user) {
        const HeapExemptionPause sealed;
        const auto* payload = static_cast<const std::byte*>(bytes);
        static_cast<KinectListener*>(user)->packet(number, ticks_before(payload),
                                                   {payload, static_cast<std::size_t>(count)});
      });
  freenect_set_depth_callback(
      device_, [](freenect_device* device, void* /*depth*/, std::uint32_t ticks) {
        const HeapExemptionPause sealed;
        static_cast<KinectListener*>(freenect_get_user(device))->frame_end(ticks);
      });
  return freenect_start_depth(device_) < 0 || transfers_refused ? kNoStream : nullptr;
}

KinectDevice::Trouble KinectDevice::process(Duration timeout) {
  const UsbPatience patience(timeout + kCloseMax);
  const auto us = std::chrono::duration_cast<std::chrono::microseconds>(timeout).count();
  timeval limit{us / 1'000'000, us % 1'000'000};
  const int done = freenect_process_events_timeout(context_, &limit);
  return done < 0 && done != LIBUSB_ERROR_INTERRUPTED ? kUnplugged : nullptr;
}

void KinectDevice::close() {
  if (context_ == nullptr) return;
  const UsbPatience patience(kCloseMax);
  // What runs must stop before its device is closed, and a device that failed to open is still in
  // the context's list: freenect_shutdown() closes it.
  if (device_ != nullptr) {
    freenect_stop_depth(device_);
    freenect_close_device(device_);
  }
  freenect_shutdown(context_);
  device_ = nullptr;
  context_ = nullptr;
}

bool KinectDevice::reset(const std::string& wanted) {
  if (start_usb() != nullptr) return false;
  const Found found = find(wanted);
  if (found.device == nullptr) return false;
  libusb_device_handle* handle = nullptr;
  bool done = libusb_open(found.device, &handle) == 0;
  if (done) {
    done = libusb_reset_device(handle) == 0;
    libusb_close(handle);
  }
  libusb_unref_device(found.device);
  return done;
}

}  // namespace wagonsight
