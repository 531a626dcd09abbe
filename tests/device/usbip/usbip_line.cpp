#include "usbip_line.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <limits>

#include "linux/clocks.h"

namespace wagonsight::device::usbip {
namespace {

constexpr Nanoseconds kNever = std::numeric_limits<Nanoseconds>::max();
constexpr std::size_t kDeviceDescriptorBytes = 18;
constexpr std::size_t kPacketBytesMax = 3 * 1024;  // of high speed: what a device may put there

Nanoseconds now() {
  return host_now().time_since_epoch().count();
}

// Of USB 2.0, table 9-4.
constexpr std::uint8_t kGetStatus = 0, kSetConfiguration = 9, kGetDescriptor = 6;
constexpr std::uint8_t kFromDevice = 0x80;
constexpr unsigned kDeviceDescriptor = 1, kConfigurationDescriptor = 2, kStringDescriptor = 3;
constexpr std::uint8_t kNotStandard = 0x60;

int give(std::span<const std::uint8_t> bytes, std::span<std::uint8_t> data) {
  const std::size_t count = std::min(bytes.size(), data.size());
  std::copy_n(bytes.begin(), count, data.begin());
  return static_cast<int>(count);
}

}  // namespace

int answer_request(UsbDevice& device, const UsbDevice::Setup& setup, std::span<std::uint8_t> data) {
  if ((setup.request_type & kNotStandard) != 0) return device.control(setup, data);
  if ((setup.request_type & kFromDevice) == 0) {
    // A configuration begins anew, also after the bus was reset; the rest changes nothing here.
    if (setup.request == kSetConfiguration) device.reset();
    return 0;
  }
  if (setup.request == kGetStatus) return give(std::array<std::uint8_t, 2>{1, 0}, data);
  if (setup.request != kGetDescriptor) return -EPIPE;
  const std::vector<std::uint8_t> bytes = device.descriptors();
  switch (setup.value >> 8U) {
    case kDeviceDescriptor:
      return give(std::span(bytes).first(kDeviceDescriptorBytes), data);
    case kConfigurationDescriptor:
      return give(std::span(bytes).subspan(kDeviceDescriptorBytes), data);
    case kStringDescriptor:
      return device.control(setup, data);
    default:
      return -EPIPE;
  }
}

UsbipLine::UsbipLine(UsbDevice& device, std::mutex& device_mutex, int descriptor)
    : device_(device),
      device_mutex_(device_mutex),
      descriptor_(descriptor),
      thread_([this] { serve(); }) {}

UsbipLine::~UsbipLine() {
  shutdown(descriptor_, SHUT_RDWR);
  thread_.join();
  close(descriptor_);
}

void UsbipLine::serve() {
  bool goes_on = true;
  while (goes_on) {
    goes_on = !wait_for_request() || take_request();
    answer_due();
  }
  is_up_ = false;
}

// True when something came, or nothing can come any more; false when an answer is due before.
bool UsbipLine::wait_for_request() {
  Nanoseconds next = kNever;
  for (const Pending& pending : pending_) next = std::min(next, pending.due);
  const Nanoseconds wait = std::max<Nanoseconds>(next == kNever ? 0 : next - now(), 0);
  const timespec time{wait / 1'000'000'000, wait % 1'000'000'000};
  pollfd wanted{descriptor_, POLLIN, 0};
  return ppoll(&wanted, 1, next == kNever ? nullptr : &time, nullptr) > 0;
}

bool UsbipLine::take_request() {
  std::array<std::uint8_t, kHeaderBytes> header{};
  if (!receive(header)) return false;
  const std::optional<Request> request = decode_request(header);
  if (!request) return false;
  if (request->is_unlink) {
    unlink(*request);
    return true;
  }
  taken_.resize(request->bytes_out());
  if (!receive(taken_)) return false;
  std::vector<PacketDescription> packets;
  for (int i = 0; i < request->packets; ++i) {
    std::array<std::uint8_t, kDescriptionBytes> bytes{};
    if (!receive(bytes)) return false;
    packets.push_back(decode_description(bytes));
  }
  if (request->packets > 0 && request->is_in) {
    queue(*request, std::move(packets));
  } else if ((request->endpoint & 0x7fU) == 0) {
    answer_control(*request);
  } else {
    SubmitReply(answer_).finish_outward(*request, -EPIPE, 0);
    send(answer_);
  }
  return true;
}

void UsbipLine::queue(const Request& request, std::vector<PacketDescription> packets) {
  Endpoint& endpoint = endpoints_[request.endpoint];
  const std::int64_t first = std::max(endpoint.next_microframe, now() / kMicroframe + 1);
  const std::int64_t end = first + request.packets;
  const std::lock_guard hold(device_mutex_);
  endpoint.next_microframe = end;
  endpoint.last_due = std::max(endpoint.last_due, end * kMicroframe + device_.lateness(end));
  pending_.push_back({request, std::move(packets), first, endpoint.last_due});
}

void UsbipLine::unlink(const Request& request) {
  const auto found = std::find_if(pending_.begin(), pending_.end(), [&](const Pending& pending) {
    return pending.request.sequence == request.victim;
  });
  const bool is_unanswered = found != pending_.end();
  if (is_unanswered) pending_.erase(found);
  send(unlink_reply(request, is_unanswered ? -ECONNRESET : 0));
}

void UsbipLine::answer_control(const Request& request) {
  int length = 0;
  SubmitReply reply(answer_);
  {
    const std::lock_guard hold(device_mutex_);
    const std::span<std::uint8_t> data =
        request.is_in ? reply.room(static_cast<std::size_t>(request.length)) : std::span(taken_);
    length = answer_request(device_, request.setup, data);
  }
  if (length == UsbDevice::kNoAnswer) {
    pending_.push_back({request, {}, 0, kNever});
    return;
  }
  const int status = std::min(length, 0);
  if (request.is_in) {
    reply.came(static_cast<std::size_t>(std::max(length, 0)));
    reply.finish(request, status);
  } else {
    reply.finish_outward(request, status, std::max(length, 0));
  }
  send(answer_);
}

void UsbipLine::answer_due() {
  const Nanoseconds time = now();
  for (auto pending = pending_.begin(); pending != pending_.end();) {
    if (pending->due > time) {
      ++pending;
      continue;
    }
    answer_isochronous(*pending);
    pending = pending_.erase(pending);
  }
}

void UsbipLine::answer_isochronous(Pending& pending) {
  SubmitReply reply(answer_);
  {
    const std::lock_guard hold(device_mutex_);
    std::int64_t microframe = pending.first_microframe;
    for (PacketDescription& packet : pending.packets) {
      const UsbDevice::IsoPacket came =
          device_.isochronous(pending.request.endpoint, microframe++, reply.room(kPacketBytesMax));
      packet.actual_length = std::min(static_cast<std::uint32_t>(came.length), packet.length);
      packet.status = came.status;
      reply.came(packet.actual_length);
    }
  }
  reply.finish(pending.request, 0, pending.packets);
  send(answer_);
}

bool UsbipLine::receive(std::span<std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t count = recv(descriptor_, bytes.data(), bytes.size(), 0);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(count));
  }
  return true;
}

// When nobody listens any more, wait_for_request() will tell.
void UsbipLine::send(std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t count = ::send(descriptor_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return;
    bytes = bytes.subspan(static_cast<std::size_t>(count));
  }
}

}  // namespace wagonsight::device::usbip
