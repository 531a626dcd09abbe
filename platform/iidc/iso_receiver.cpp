#include "iidc/iso_receiver.h"

#include <fcntl.h>
#include <linux/firewire-cdev.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <time.h>  // NOLINT(modernize-deprecated-headers): POSIX clocks
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace wagonsight {
namespace {

constexpr std::uint32_t kHeaderBytes = 8;          // of a packet: its header and its stamp
constexpr std::uint32_t kAbiVersion = 5;           // Linux 3.4
constexpr std::uint64_t kLegacyChannels = 0xffff;  // what four bits of a register can say
constexpr int kReserveMax_ms = 1000;

constexpr auto kForbidden =
    "the camera's bus may not be used; give the service's user access to /dev/fw* (udev rule)";
constexpr auto kOldKernel = "the kernel's IEEE 1394 is too old; Linux 3.4 or later is needed";
constexpr auto kNoBandwidth =
    "the camera's bus has no bandwidth or channel left; move a camera to another IEEE 1394 card";
constexpr auto kNoContext =
    "the IEEE 1394 card cannot receive another camera; move one to another card";
constexpr auto kNoMemory = "there is no memory for the camera's packets; stop other programs";
constexpr auto kUnplugged =
    "the stereo camera was unplugged or lost its power; check plug and supply";
constexpr auto kBroken = "the camera's packets cannot be read any more; it is being opened again";

std::uint32_t big_endian(const std::byte* bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < 4; ++i) value = value << 8U | std::to_integer<std::uint32_t>(bytes[i]);
  return value;
}

bool wait_for(int fd, int timeout_ms, short& what) {
  pollfd one{fd, POLLIN, 0};
  const int ready = poll(&one, 1, timeout_ms);
  what = one.revents;
  return ready > 0;
}

}  // namespace

IsoReceiver::Trouble IsoReceiver::start(const std::string& path, int packet_bytes,
                                        int bandwidth_units) {
  stop();
  fd_ = open(path.c_str(), O_RDWR | O_CLOEXEC);
  if (fd_ < 0) return errno == EACCES || errno == EPERM ? kForbidden : kUnplugged;
  packet_bytes_ = static_cast<std::size_t>(packet_bytes);
  fw_cdev_get_info info{};
  info.version = kAbiVersion;
  Trouble trouble = nullptr;
  if (ioctl(fd_, FW_CDEV_IOC_GET_INFO, &info) != 0)
    trouble = kUnplugged;
  else if (info.version < kAbiVersion)
    trouble = kOldKernel;
  if (trouble == nullptr) trouble = reserve(bandwidth_units);
  if (trouble == nullptr) trouble = begin();
  if (trouble != nullptr) stop();
  return trouble;
}

IsoReceiver::Trouble IsoReceiver::reserve(int bandwidth_units) {
  fw_cdev_allocate_iso_resource wanted{};
  wanted.channels = kLegacyChannels;
  wanted.bandwidth = static_cast<std::uint32_t>(bandwidth_units);
  if (ioctl(fd_, FW_CDEV_IOC_ALLOCATE_ISO_RESOURCE, &wanted) != 0) return kNoBandwidth;
  // The kernel asks the bus's manager and tells what came of it; news of resets may come before.
  while (true) {
    short what = 0;
    if (!wait_for(fd_, kReserveMax_ms, what)) return kNoBandwidth;
    fw_cdev_event_iso_resource told{};
    const ssize_t count = read(fd_, event_.data(), event_.size());
    if (count < static_cast<ssize_t>(sizeof(fw_cdev_event_common))) return kUnplugged;
    std::memcpy(&told, event_.data(), std::min(static_cast<std::size_t>(count), sizeof told));
    if (told.type != FW_CDEV_EVENT_ISO_RESOURCE_ALLOCATED) continue;
    channel_ = told.channel;
    return told.channel < 0 || told.bandwidth < bandwidth_units ? kNoBandwidth : nullptr;
  }
}

IsoReceiver::Trouble IsoReceiver::begin() {
  fw_cdev_create_iso_context context{};
  context.type = FW_CDEV_ISO_CONTEXT_RECEIVE;
  context.header_size = kHeaderBytes;
  context.channel = static_cast<std::uint32_t>(channel_);
  if (ioctl(fd_, FW_CDEV_IOC_CREATE_ISO_CONTEXT, &context) != 0) return kNoContext;
  memory_bytes_ = kPackets * packet_bytes_;
  void* const memory = mmap(nullptr, memory_bytes_, PROT_READ | PROT_WRITE, MAP_SHARED, fd_, 0);
  if (memory == MAP_FAILED) return kNoMemory;
  memory_ = static_cast<std::byte*>(memory);
  next_packet_ = 0;
  if (!queue(0, kEntries)) return kNoMemory;
  fw_cdev_start_iso start{};
  start.cycle = -1;
  start.tags = FW_CDEV_ISO_CONTEXT_MATCH_ALL_TAGS;
  return ioctl(fd_, FW_CDEV_IOC_START_ISO, &start) == 0 ? nullptr : kNoContext;
}

void IsoReceiver::stop() {
  if (fd_ < 0) return;
  fw_cdev_stop_iso stop{};
  if (memory_ != nullptr) {
    (void)ioctl(fd_, FW_CDEV_IOC_STOP_ISO, &stop);
    munmap(memory_, memory_bytes_);
  }
  close(fd_);
  fd_ = -1;
  memory_ = nullptr;
  channel_ = -1;
}

// Lets the controller write into these entries (again).
bool IsoReceiver::queue(std::size_t first_entry, std::size_t count) {
  std::array<std::uint32_t, kEntries> entries{};
  while (count > 0) {
    const std::size_t now = std::min(count, kEntries - first_entry);
    for (std::size_t i = 0; i < now; ++i) {
      entries[i] =
          FW_CDEV_ISO_HEADER_LENGTH(kHeaderBytes * kPacketsOfEntry) |
          FW_CDEV_ISO_PAYLOAD_LENGTH(static_cast<std::uint32_t>(packet_bytes_ * kPacketsOfEntry));
      if ((first_entry + i + 1) % kEntriesOfInterrupt == 0) entries[i] |= FW_CDEV_ISO_INTERRUPT;
    }
    fw_cdev_queue_iso queued{};
    queued.packets = reinterpret_cast<std::uintptr_t>(entries.data());
    queued.data =
        reinterpret_cast<std::uintptr_t>(memory_ + first_entry * kPacketsOfEntry * packet_bytes_);
    queued.size = static_cast<std::uint32_t>(now * sizeof entries[0]);
    if (ioctl(fd_, FW_CDEV_IOC_QUEUE_ISO, &queued) < 0) return false;
    first_entry = (first_entry + now) % kEntries;
    count -= now;
  }
  return true;
}

IsoReceiver::Trouble IsoReceiver::wait(Duration timeout, IsoListener& listener) {
  auto left_ms = static_cast<int>(std::chrono::ceil<std::chrono::milliseconds>(timeout).count());
  short what = 0;
  while (wait_for(fd_, std::max(left_ms, 0), what)) {
    // What came before it was unplugged is read first.
    if ((what & POLLIN) == 0) return kUnplugged;
    if (const Trouble trouble = read_event(listener)) return trouble;
    left_ms = 0;
  }
  return nullptr;
}

IsoReceiver::Trouble IsoReceiver::flush(IsoListener& listener) {
  fw_cdev_flush_iso flush{};
  if (ioctl(fd_, FW_CDEV_IOC_FLUSH_ISO, &flush) != 0) return errno == ENODEV ? kUnplugged : kBroken;
  return wait({}, listener);
}

IsoReceiver::Trouble IsoReceiver::read_event(IsoListener& listener) {
  const ssize_t count = read(fd_, event_.data(), event_.size());
  if (count < 0) return errno == ENODEV ? kUnplugged : kBroken;
  constexpr std::size_t kHead = offsetof(fw_cdev_event_iso_interrupt, header);
  fw_cdev_event_iso_interrupt told{};
  std::memcpy(&told, event_.data(), std::min(static_cast<std::size_t>(count), sizeof told));
  if (told.type != FW_CDEV_EVENT_ISO_INTERRUPT) return nullptr;
  if (kHead + told.header_length > static_cast<std::size_t>(count)) return kBroken;
  return take_headers(event_.data() + kHead, told.header_length, listener) ? nullptr : kBroken;
}

bool IsoReceiver::take_headers(const std::byte* headers, std::size_t bytes, IsoListener& listener) {
  const std::size_t first_entry = next_packet_ / kPacketsOfEntry;
  std::size_t entries_done = 0;
  for (std::size_t at = 0; at + kHeaderBytes <= bytes; at += kHeaderBytes) {
    const std::uint32_t header = big_endian(headers + at);
    IsoPacket packet;
    packet.length = static_cast<int>(header >> 16U);
    packet.begins_image = (header & 0xfU) == 1;
    packet.stamp = static_cast<std::uint16_t>(big_endian(headers + at + 4));
    packet.payload = {memory_ + next_packet_ * packet_bytes_,
                      std::min(static_cast<std::size_t>(packet.length), packet_bytes_)};
    listener.packet(packet);
    next_packet_ = (next_packet_ + 1) % kPackets;
    if (next_packet_ % kPacketsOfEntry == 0) ++entries_done;
  }
  return queue(first_entry, entries_done);
}

IsoReceiver::Clocks IsoReceiver::read_clocks() const {
  fw_cdev_get_cycle_timer2 both{};
  both.clk_id = CLOCK_MONOTONIC;
  if (ioctl(fd_, FW_CDEV_IOC_GET_CYCLE_TIMER2, &both) != 0) return {};
  return {true, both.cycle_timer,
          HostTime(std::chrono::seconds(both.tv_sec) + std::chrono::nanoseconds(both.tv_nsec))};
}

}  // namespace wagonsight
