#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "usb_device.h"

// USB/IP as the kernel's vhci_hcd speaks it with whoever has the device
// (Documentation/usb/usbip_protocol.rst): the kernel submits transfers and takes some back, each is
// answered. Every message begins with 48 bytes; all numbers but the setup packet's are big-endian.
namespace wagonsight::device::usbip {

inline constexpr std::size_t kHeaderBytes = 48;
inline constexpr std::size_t kDescriptionBytes = 16;  // of one isochronous packet
inline constexpr int kPacketsMax = 1024;              // of one transfer; the kernel's own limit
inline constexpr int kTransferBytesMax = 1 << 20;

// What the kernel wants.
struct Request {
  bool is_unlink = false;
  std::uint32_t sequence = 0;
  std::uint32_t victim = 0;  // of an unlink: the sequence of the transfer that is taken back
  // The rest is a submitted transfer's.
  bool is_in = false;  // towards the host
  std::uint8_t endpoint = 0;
  int length = 0;   // of its buffer
  int packets = 0;  // 0: not isochronous
  UsbDevice::Setup setup;
  std::uint16_t setup_length = 0;  // of the data stage that a control request asks for

  // What follows the header: an outward transfer's bytes, then the descriptions of packets.
  std::size_t bytes_out() const;
  std::size_t description_bytes() const;
};
// Nothing when no kernel says such a thing: the line is out of step.
std::optional<Request> decode_request(std::span<const std::uint8_t, kHeaderBytes> header);

// One isochronous packet, in the transfer's buffer.
struct PacketDescription {
  std::uint32_t offset = 0;         // where it lies there
  std::uint32_t length = 0;         // of its place
  std::uint32_t actual_length = 0;  // of what came
  std::int32_t status = 0;          // 0 or -errno
};
PacketDescription decode_description(std::span<const std::uint8_t, kDescriptionBytes> bytes);

// An answer to a submitted transfer, which is put together in `bytes`: its header, then what came,
// isochronous packets without the gaps between them, then their descriptions.
class SubmitReply {
 public:
  explicit SubmitReply(std::vector<std::uint8_t>& bytes);
  // Room for so much more of what came, at its end.
  std::span<std::uint8_t> room(std::size_t count);
  // So much of it was used.
  void came(std::size_t count) { came_ += count; }
  // The reply is complete. `status`: 0 or -errno. What an outward transfer took is no data.
  void finish(const Request& request, int status, std::span<const PacketDescription> packets = {});
  void finish_outward(const Request& request, int status, int taken);

 private:
  void write_header(const Request& request, int status, std::size_t actual_length,
                    std::span<const PacketDescription> packets);

  std::vector<std::uint8_t>& bytes_;
  std::size_t came_ = 0;
};

// `status`: -ECONNRESET when the transfer had not been answered yet, else 0.
std::array<std::uint8_t, kHeaderBytes> unlink_reply(const Request& request, int status);

}  // namespace wagonsight::device::usbip
