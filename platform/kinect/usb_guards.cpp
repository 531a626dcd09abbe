#include "kinect/usb_guards.h"

#include <libusb.h>

#include <algorithm>
#include <atomic>
#include <optional>

#include "base/check.h"
#include "linux/clocks.h"

#ifndef WAGONSIGHT_STATIC_USB
#include <dlfcn.h>
#endif

namespace wagonsight {
namespace {

constexpr Duration kRequestMax = std::chrono::seconds(1);

struct Patience {
  std::optional<HostTime> until;
  bool is_spent = false;
};
thread_local Patience patience;

std::atomic<std::uint64_t> packet_errors{0};
// libfreenect has one callback for all its isochronous transfers.
std::atomic<libusb_transfer_cb_fn> library_callback{nullptr};

void LIBUSB_CALL drop_damaged_packets(libusb_transfer* transfer) {
  for (int i = 0; i < transfer->num_iso_packets; ++i) {
    libusb_iso_packet_descriptor& packet = transfer->iso_packet_desc[i];
    if (packet.status == LIBUSB_TRANSFER_COMPLETED || packet.actual_length == 0) continue;
    packet.actual_length = 0;
    packet_errors.fetch_add(1, std::memory_order_relaxed);
  }
  library_callback.load(std::memory_order_acquire)(transfer);
}

using SubmitFunction = int (*)(libusb_transfer*);
using ControlFunction = int (*)(libusb_device_handle*, std::uint8_t, std::uint8_t, std::uint16_t,
                                std::uint16_t, unsigned char*, std::uint16_t, unsigned);

int guarded_submit(SubmitFunction submit, libusb_transfer* transfer) {
  if (transfer->type == LIBUSB_TRANSFER_TYPE_ISOCHRONOUS &&
      transfer->callback != drop_damaged_packets) {
    libusb_transfer_cb_fn known = nullptr;
    if (!library_callback.compare_exchange_strong(known, transfer->callback))
      WS_CHECK(known == transfer->callback, "%s", "two users of isochronous transfers");
    transfer->callback = drop_damaged_packets;
  }
  return submit(transfer);
}

template <class... Arguments>
int guarded_control(ControlFunction control, unsigned timeout_ms, Arguments... arguments) {
  Duration left = kRequestMax;
  if (patience.until) {
    left = std::min(left, *patience.until - host_now());
    if (left <= Duration::zero()) {
      patience.is_spent = true;
      return LIBUSB_ERROR_TIMEOUT;
    }
  }
  const auto left_ms = static_cast<unsigned>(left / std::chrono::milliseconds(1)) + 1;
  const int done = control(arguments..., timeout_ms == 0 ? left_ms : std::min(timeout_ms, left_ms));
  if (done == LIBUSB_ERROR_TIMEOUT) patience.is_spent = true;
  return done;
}

}  // namespace

UsbPatience::UsbPatience(Duration limit) {
  patience = {host_now() + limit, false};
}
UsbPatience::~UsbPatience() {
  patience = {};
}
bool UsbPatience::is_spent() const {
  return patience.is_spent;
}

std::uint64_t usb_packet_errors() {
  return packet_errors.load(std::memory_order_relaxed);
}

}  // namespace wagonsight

// NOLINTBEGIN(bugprone-reserved-identifier,readability-identifier-naming)
extern "C" {
#ifdef WAGONSIGHT_STATIC_USB  // linked with
                              // --wrap=libusb_submit_transfer,--wrap=libusb_control_transfer

int __real_libusb_submit_transfer(libusb_transfer* transfer);
int __real_libusb_control_transfer(libusb_device_handle*, std::uint8_t, std::uint8_t, std::uint16_t,
                                   std::uint16_t, unsigned char*, std::uint16_t, unsigned);

int __wrap_libusb_submit_transfer(libusb_transfer* transfer) {
  return wagonsight::guarded_submit(__real_libusb_submit_transfer, transfer);
}
int __wrap_libusb_control_transfer(libusb_device_handle* device, std::uint8_t type,
                                   std::uint8_t request, std::uint16_t value, std::uint16_t index,
                                   unsigned char* data, std::uint16_t length, unsigned timeout_ms) {
  return wagonsight::guarded_control(__real_libusb_control_transfer, timeout_ms, device, type,
                                     request, value, index, data, length);
}

#else  // the loader finds these before those of the shared libusb

int libusb_submit_transfer(libusb_transfer* transfer) {
  static const auto next =
      reinterpret_cast<wagonsight::SubmitFunction>(dlsym(RTLD_NEXT, "libusb_submit_transfer"));
  return wagonsight::guarded_submit(next, transfer);
}
int libusb_control_transfer(libusb_device_handle* device, std::uint8_t type, std::uint8_t request,
                            std::uint16_t value, std::uint16_t index, unsigned char* data,
                            std::uint16_t length, unsigned timeout_ms) {
  static const auto next =
      reinterpret_cast<wagonsight::ControlFunction>(dlsym(RTLD_NEXT, "libusb_control_transfer"));
  return wagonsight::guarded_control(next, timeout_ms, device, type, request, value, index, data,
                                     length);
}

#endif
}  // extern "C"
// NOLINTEND(bugprone-reserved-identifier,readability-identifier-naming)
