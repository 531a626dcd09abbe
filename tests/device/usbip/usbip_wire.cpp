#include "usbip_wire.h"

#include <algorithm>

namespace wagonsight::device::usbip {
namespace {

constexpr std::uint32_t kSubmit = 1, kUnlink = 2, kSubmitReply = 3, kUnlinkReply = 4;
constexpr std::uint32_t kIn = 1;
constexpr std::uint32_t kNotIsochronous = 0xffffffff;  // some kernels say 0 instead

// Where things lie in a header.
constexpr std::size_t kCommandAt = 0, kSequenceAt = 4, kDirectionAt = 12, kEndpointAt = 16;
constexpr std::size_t kVictimAt = 20, kLengthAt = 24, kPacketsAt = 32, kSetupAt = 40;  // asked
constexpr std::size_t kStatusAt = 20, kActualLengthAt = 24, kErrorsAt = 36;            // answered

std::uint32_t number_at(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint32_t>(bytes[at]) << 24U |
         static_cast<std::uint32_t>(bytes[at + 1]) << 16U |
         static_cast<std::uint32_t>(bytes[at + 2]) << 8U | bytes[at + 3];
}
void put_number(std::span<std::uint8_t> bytes, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i)
    bytes[at + i] = static_cast<std::uint8_t>(value >> (24U - 8U * i));
}
std::uint16_t little_word(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint16_t>(bytes[at] | bytes[at + 1] << 8);
}

}  // namespace

std::size_t Request::bytes_out() const {
  return is_unlink || is_in ? 0 : static_cast<std::size_t>(length);
}
std::size_t Request::description_bytes() const {
  return static_cast<std::size_t>(packets) * kDescriptionBytes;
}

std::optional<Request> decode_request(std::span<const std::uint8_t, kHeaderBytes> header) {
  Request request;
  const std::uint32_t command = number_at(header, kCommandAt);
  if (command != kSubmit && command != kUnlink) return std::nullopt;
  request.sequence = number_at(header, kSequenceAt);
  request.is_unlink = command == kUnlink;
  if (request.is_unlink) {
    request.victim = number_at(header, kVictimAt);
    return request;
  }
  const std::uint32_t endpoint = number_at(header, kEndpointAt);
  const std::uint32_t length = number_at(header, kLengthAt);
  const std::uint32_t packets = number_at(header, kPacketsAt);
  const bool is_isochronous = packets != kNotIsochronous && packets != 0;
  if (endpoint > 15 || length > kTransferBytesMax || (is_isochronous && packets > kPacketsMax))
    return std::nullopt;
  request.is_in = number_at(header, kDirectionAt) == kIn;
  request.endpoint = static_cast<std::uint8_t>(endpoint | (request.is_in ? 0x80U : 0U));
  request.length = static_cast<int>(length);
  request.packets = is_isochronous ? static_cast<int>(packets) : 0;
  request.setup = {header[kSetupAt], header[kSetupAt + 1], little_word(header, kSetupAt + 2),
                   little_word(header, kSetupAt + 4)};
  request.setup_length = little_word(header, kSetupAt + 6);
  return request;
}

PacketDescription decode_description(std::span<const std::uint8_t, kDescriptionBytes> bytes) {
  return {number_at(bytes, 0), number_at(bytes, 4), number_at(bytes, 8),
          static_cast<std::int32_t>(number_at(bytes, 12))};
}

SubmitReply::SubmitReply(std::vector<std::uint8_t>& bytes) : bytes_(bytes) {
  bytes_.assign(kHeaderBytes, 0);
}

std::span<std::uint8_t> SubmitReply::room(std::size_t count) {
  bytes_.resize(std::max(bytes_.size(), kHeaderBytes + came_ + count));
  return std::span(bytes_).subspan(kHeaderBytes + came_, count);
}

void SubmitReply::finish(const Request& request, int status,
                         std::span<const PacketDescription> packets) {
  const std::size_t descriptions_at = kHeaderBytes + came_;
  bytes_.resize(descriptions_at + packets.size() * kDescriptionBytes);
  write_header(request, status, came_, packets);
  std::span<std::uint8_t> place = std::span(bytes_).subspan(descriptions_at);
  for (const PacketDescription& packet : packets) {
    put_number(place, 0, packet.offset);
    put_number(place, 4, packet.length);
    put_number(place, 8, packet.actual_length);
    put_number(place, 12, static_cast<std::uint32_t>(packet.status));
    place = place.subspan(kDescriptionBytes);
  }
}

void SubmitReply::finish_outward(const Request& request, int status, int taken) {
  bytes_.resize(kHeaderBytes);
  write_header(request, status, static_cast<std::size_t>(taken), {});
}

void SubmitReply::write_header(const Request& request, int status, std::size_t actual_length,
                               std::span<const PacketDescription> packets) {
  // Device, direction and endpoint of an answer mean nothing.
  put_number(bytes_, kCommandAt, kSubmitReply);
  put_number(bytes_, kSequenceAt, request.sequence);
  put_number(bytes_, kStatusAt, static_cast<std::uint32_t>(status));
  put_number(bytes_, kActualLengthAt, static_cast<std::uint32_t>(actual_length));
  put_number(bytes_, kPacketsAt, static_cast<std::uint32_t>(packets.size()));
  const auto errors =
      std::count_if(packets.begin(), packets.end(),
                    [](const PacketDescription& packet) { return packet.status != 0; });
  put_number(bytes_, kErrorsAt, static_cast<std::uint32_t>(errors));
}

std::array<std::uint8_t, kHeaderBytes> unlink_reply(const Request& request, int status) {
  std::array<std::uint8_t, kHeaderBytes> bytes{};
  put_number(bytes, kCommandAt, kUnlinkReply);
  put_number(bytes, kSequenceAt, request.sequence);
  put_number(bytes, kStatusAt, static_cast<std::uint32_t>(status));
  return bytes;
}

}  // namespace wagonsight::device::usbip
