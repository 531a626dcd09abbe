#include "fire_file.h"

#include <linux/firewire-cdev.h>
#include <linux/firewire-constants.h>
#include <poll.h>
#include <sys/mman.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstddef>
#include <cstring>

namespace wagonsight::device {
namespace {

constexpr std::uint64_t kRegisters = 0xfffff0000000;
constexpr std::uint64_t kFirstForBroadcasts = 0xfffff0000800;
constexpr std::uint32_t kAbiVersion = 5;
constexpr Nanoseconds kTransaction = 100'000;
constexpr Nanoseconds kSplitTimeout = 2'000'000'000;  // the kernel's
constexpr std::size_t kHeaderPage = 4096;             // the kernel's, for headers not yet told
constexpr int kCyclesPerSecond = 8000;

// The controller's own node: nothing but its identity.
std::vector<std::uint32_t> controller_rom(int number) {
  const auto unique = static_cast<std::uint32_t>(number);
  return {0x04040000, 0x31333934, 0xf000a232, 0x00110600, unique, 0x00010000, 0x03001106};
}

std::uint32_t swapped(std::uint32_t x) {
  return x >> 24U | (x >> 8U & 0xff00U) | (x & 0xff00U) << 8U | x << 24U;
}

template <class T>
T* at(std::uint64_t address) {
  static_assert(sizeof(T*) == sizeof address);
  return std::bit_cast<T*>(address);
}

double share_of(std::int64_t cycle) {  // 0 .. 1, the same in every run
  auto x = static_cast<std::uint64_t>(cycle) * 0x9E3779B97F4A7C15ULL;
  x = (x ^ (x >> 31U)) * 0xBF58476D1CE4E5B9ULL;
  return static_cast<double>(x >> 11U) * 0x1p-53;
}

}  // namespace

FireFile::FireFile(std::shared_ptr<FireBuses::Node> node) : node_(std::move(node)) {
  FireBuses::instance().add_file(this);
}

FireFile::~FireFile() {
  while (!resources_.empty()) deallocate(resources_.back().handle);
  FireBuses::instance().remove_file(this);
}

// ---- events

// What follows an event's structure begins in the padding of its end, as the kernel's does.
constexpr std::size_t kRestAt = offsetof(fw_cdev_event_iso_interrupt, header);
static_assert(kRestAt == offsetof(fw_cdev_event_response, data));

template <class T>
void FireFile::tell(const T& event, Nanoseconds when, std::span<const std::uint32_t> rest) {
  Event told{when, std::vector<std::uint8_t>(sizeof event + rest.size_bytes())};
  std::memcpy(told.bytes.data(), &event, sizeof event);
  if (!rest.empty()) std::memcpy(told.bytes.data() + kRestAt, rest.data(), rest.size_bytes());
  const auto later = std::find_if(events_.begin(), events_.end(),
                                  [&](const Event& other) { return other.when > when; });
  events_.insert(later, std::move(told));
}

void FireFile::tell_bus_reset() {
  if (!node_->present) return;
  fw_cdev_event_bus_reset event{};
  event.closure = reset_closure_;
  event.type = FW_CDEV_EVENT_BUS_RESET;
  event.node_id = node_->node_id;
  event.local_node_id = 0xffc0;
  event.generation = bus().generation;
  tell(event, VirtualTime::instance().now());
}

short FireFile::events() {
  receive_until_now();
  int now = node_->present ? 0 : POLLERR | POLLHUP;
  if (!events_.empty() && events_.front().when <= VirtualTime::instance().now()) now |= POLLIN;
  return static_cast<short>(now);
}

Nanoseconds FireFile::next_change() {
  Nanoseconds next = events_.empty() ? VirtualTime::kNever : events_.front().when;
  if (!runs_ || !node_->present || !node_->device || buffers_.empty()) return next;
  // The packet that makes the next interrupt comes at the earliest when all before it have come.
  const auto interrupting = std::find_if(buffers_.begin(), buffers_.end(),
                                         [](const Buffer& buffer) { return buffer.interrupts; });
  const std::int64_t first = node_->device->next_packet(next_cycle_);
  if (first == kNoCycle) return next;
  const std::int64_t last = first + (interrupting - buffers_.begin());
  return std::min(next, bus().clock.host_at_cycle(last + 1));
}

ssize_t FireFile::read(void* buffer, std::size_t bytes) {
  receive_until_now();
  if (events_.empty() || events_.front().when > VirtualTime::instance().now())
    return node_->present ? -EAGAIN : -ENODEV;
  const Event event = std::move(events_.front());
  events_.pop_front();
  const std::size_t count = std::min(bytes, event.bytes.size());
  std::memcpy(buffer, event.bytes.data(), count);
  return static_cast<ssize_t>(count);
}

void* FireFile::map(std::size_t bytes) {
  void* const memory =
      mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  return memory == MAP_FAILED ? nullptr : memory;
}

// ---- requests

int FireFile::ioctl(unsigned long request, void* argument) {
  if (!node_->present) return -ENODEV;
  FireBuses::instance().catch_up(node_->bus);
  switch (request) {
    case FW_CDEV_IOC_GET_INFO:
      return get_info(*static_cast<fw_cdev_get_info*>(argument));
    case FW_CDEV_IOC_SEND_REQUEST:
      return send_request(*static_cast<fw_cdev_send_request*>(argument));
    case FW_CDEV_IOC_SEND_BROADCAST_REQUEST:
      return send_broadcast(*static_cast<fw_cdev_send_request*>(argument));
    case FW_CDEV_IOC_ALLOCATE_ISO_RESOURCE:
      return allocate(*static_cast<fw_cdev_allocate_iso_resource*>(argument));
    case FW_CDEV_IOC_DEALLOCATE_ISO_RESOURCE:
      return deallocate(static_cast<fw_cdev_deallocate*>(argument)->handle);
    case FW_CDEV_IOC_CREATE_ISO_CONTEXT: {
      auto& wanted = *static_cast<fw_cdev_create_iso_context*>(argument);
      if (has_context_) return -EBUSY;
      if (wanted.type != FW_CDEV_ISO_CONTEXT_RECEIVE || wanted.header_size % 4 != 0) return -EINVAL;
      has_context_ = true;
      channel_ = static_cast<int>(wanted.channel);
      header_bytes_ = wanted.header_size;
      context_closure_ = wanted.closure;
      wanted.handle = 0;
      return 0;
    }
    case FW_CDEV_IOC_QUEUE_ISO:
      return queue(*static_cast<fw_cdev_queue_iso*>(argument));
    case FW_CDEV_IOC_START_ISO:
      if (!has_context_ || runs_) return -EINVAL;
      runs_ = true;
      next_cycle_ = bus().clock.cycle_at(VirtualTime::instance().now());
      return 0;
    case FW_CDEV_IOC_STOP_ISO:
      runs_ = false;
      buffers_.clear();
      return 0;
    case FW_CDEV_IOC_FLUSH_ISO:
      tell_received(next_cycle_ - 1, VirtualTime::instance().now());
      return 0;
    case FW_CDEV_IOC_GET_CYCLE_TIMER:
    case FW_CDEV_IOC_GET_CYCLE_TIMER2:
      return get_cycle_timer(request == FW_CDEV_IOC_GET_CYCLE_TIMER2, argument);
    case FW_CDEV_IOC_INITIATE_BUS_RESET:
      FireBuses::instance().reset_bus(node_->bus);
      return 0;
    default:
      return -EINVAL;
  }
}

int FireFile::get_info(fw_cdev_get_info& info) {
  const auto rom = node_->device ? node_->device->config_rom() : controller_rom(node_->number);
  const std::size_t bytes = std::min<std::size_t>(info.rom_length, rom.size() * 4);
  if (info.rom != 0) std::memcpy(at<void>(info.rom), rom.data(), bytes);
  info.rom_length = static_cast<std::uint32_t>(rom.size() * 4);
  info.version = kAbiVersion;
  info.card = static_cast<std::uint32_t>(node_->bus);
  reset_closure_ = info.bus_reset_closure;
  if (info.bus_reset != 0) {
    fw_cdev_event_bus_reset state{};
    state.type = FW_CDEV_EVENT_BUS_RESET;
    state.node_id = node_->node_id;
    state.local_node_id = 0xffc0;
    state.generation = bus().generation;
    std::memcpy(at<void>(info.bus_reset), &state, sizeof state);
  }
  return 0;
}

void FireFile::respond(std::uint64_t closure, int rcode, std::span<const std::uint32_t> data) {
  fw_cdev_event_response event{};
  event.closure = closure;
  event.type = FW_CDEV_EVENT_RESPONSE;
  event.rcode =
      static_cast<std::uint32_t>(rcode == FireDevice::kNoAnswer ? RCODE_CANCELLED : rcode);
  event.length = static_cast<std::uint32_t>(data.size_bytes());
  const Nanoseconds after = rcode == FireDevice::kNoAnswer ? kSplitTimeout : kTransaction;
  tell(event, VirtualTime::instance().now() + after, data);
}

int FireFile::send_request(const fw_cdev_send_request& request) {
  std::vector<std::uint32_t> data(request.length / 4);
  if (request.generation != bus().generation) {
    respond(request.closure, RCODE_GENERATION, {});
    return 0;
  }
  if (!node_->device || request.offset < kRegisters) {
    respond(request.closure, RCODE_ADDRESS_ERROR, {});
    return 0;
  }
  const bool reads =
      request.tcode == TCODE_READ_QUADLET_REQUEST || request.tcode == TCODE_READ_BLOCK_REQUEST;
  int rcode = RCODE_COMPLETE;
  for (std::size_t i = 0; i < data.size() && rcode == RCODE_COMPLETE; ++i) {
    const std::uint64_t offset = request.offset - kRegisters + 4 * i;
    if (reads)
      rcode = node_->device->read(offset, data[i]);
    else
      rcode = node_->device->write(offset, swapped(at<const std::uint32_t>(request.data)[i]));
    data[i] = swapped(data[i]);
  }
  if (!reads || rcode != RCODE_COMPLETE) data.clear();
  respond(request.closure, rcode, data);
  return 0;
}

int FireFile::send_broadcast(const fw_cdev_send_request& request) {
  if (request.offset < kFirstForBroadcasts) return -EACCES;
  for (const auto& node : FireBuses::instance().nodes())
    for (std::size_t i = 0; i < request.length / 4; ++i)
      if (node->bus == node_->bus && node->device)
        node->device->write(request.offset - kRegisters + 4 * i,
                            swapped(at<const std::uint32_t>(request.data)[i]));
  respond(request.closure, RCODE_COMPLETE, {});
  return 0;
}

int FireFile::get_cycle_timer(bool is_second, void* argument) {
  const Nanoseconds host = VirtualTime::instance().now();
  const Nanoseconds time = bus().clock.time_at(host);
  const auto cycles = static_cast<std::uint64_t>(time / kCycle);
  const auto offset = static_cast<std::uint64_t>(time % kCycle) * 3072 / kCycle;
  const auto timer = static_cast<std::uint32_t>((cycles / kCyclesPerSecond % 128) << 25U |
                                                cycles % kCyclesPerSecond << 12U | offset);
  if (is_second) {
    auto& out = *static_cast<fw_cdev_get_cycle_timer2*>(argument);
    out.tv_sec = host / 1'000'000'000;
    out.tv_nsec = static_cast<std::int32_t>(host % 1'000'000'000);
    out.cycle_timer = timer;
  } else {
    auto& out = *static_cast<fw_cdev_get_cycle_timer*>(argument);
    out.local_time = static_cast<std::uint64_t>(host) / 1000;
    out.cycle_timer = timer;
  }
  return 0;
}

// ---- isochronous resources

int FireFile::allocate(fw_cdev_allocate_iso_resource& wanted) {
  static std::uint32_t last_handle = 0;
  Resource resource{++last_handle, -1, 0, wanted.closure};
  const std::uint64_t free = wanted.channels & ~bus().channels_used;
  const bool fits = static_cast<int>(wanted.bandwidth) <= bus().bandwidth_left;
  if (fits && free != 0) {
    resource.channel = std::countr_zero(free);
    resource.bandwidth = static_cast<int>(wanted.bandwidth);
    bus().channels_used |= std::uint64_t{1} << static_cast<unsigned>(resource.channel);
    bus().bandwidth_left -= resource.bandwidth;
  }
  wanted.handle = resource.handle;
  resources_.push_back(resource);
  fw_cdev_event_iso_resource event{};
  event.closure = wanted.closure;
  event.type = FW_CDEV_EVENT_ISO_RESOURCE_ALLOCATED;
  event.handle = resource.handle;
  event.channel = resource.channel;
  event.bandwidth = resource.bandwidth;
  tell(event, VirtualTime::instance().now() + kTransaction);
  return 0;
}

int FireFile::deallocate(std::uint32_t handle) {
  const auto found = std::find_if(resources_.begin(), resources_.end(),
                                  [&](const Resource& r) { return r.handle == handle; });
  if (found == resources_.end()) return -EINVAL;
  if (found->channel >= 0)
    bus().channels_used &= ~(std::uint64_t{1} << static_cast<unsigned>(found->channel));
  bus().bandwidth_left += found->bandwidth;
  fw_cdev_event_iso_resource event{};
  event.closure = found->closure;
  event.type = FW_CDEV_EVENT_ISO_RESOURCE_DEALLOCATED;
  event.handle = handle;
  event.channel = found->channel;
  event.bandwidth = found->bandwidth;
  resources_.erase(found);
  tell(event, VirtualTime::instance().now() + kTransaction);
  return 0;
}

// ---- isochronous reception

int FireFile::queue(fw_cdev_queue_iso& wanted) {
  if (!has_context_) return -EINVAL;
  const auto* entry = at<const std::uint32_t>(wanted.packets);
  auto* data = at<std::uint8_t>(wanted.data);
  for (std::uint32_t i = 0; i < wanted.size / 4; ++i) {
    const std::uint32_t control = entry[i];
    const std::uint32_t packets = (control >> 24U) / header_bytes_;
    if (packets == 0 || (control >> 24U) % header_bytes_ != 0) return -EINVAL;
    const auto each = static_cast<int>((control & 0xffffU) / packets);
    for (std::uint32_t p = 0; p < packets; ++p, data += each)
      buffers_.push_back({data, each, p + 1 == packets && (control & FW_CDEV_ISO_INTERRUPT) != 0});
  }
  wanted.size = 0;
  return 0;
}

void FireFile::receive_until_now() {
  if (!runs_ || !node_->present || !node_->device) return;
  const std::int64_t end = bus().clock.cycle_at(VirtualTime::instance().now());
  while (true) {
    const std::int64_t cycle = node_->device->next_packet(next_cycle_);
    if (cycle >= end) break;
    next_cycle_ = cycle + 1;
    receive(cycle);
  }
  next_cycle_ = std::max(next_cycle_, end);
}

void FireFile::receive(std::int64_t cycle) {
  const bool has_room = !buffers_.empty() && cycle >= bus().quiet_until;
  const Buffer buffer = has_room ? buffers_.front() : Buffer{};
  const FireDevice::Packet packet =
      node_->device->isochronous(cycle, {buffer.data, static_cast<std::size_t>(buffer.length)});
  if (!has_room || packet.channel != channel_) return;
  buffers_.pop_front();
  const auto length = static_cast<std::uint32_t>(packet.length);
  headers_.push_back(swapped(length << 16U | 1U << 14U |
                             static_cast<std::uint32_t>(packet.channel) << 8U | 0xaU << 4U |
                             packet.sy));
  if (header_bytes_ >= 8)
    headers_.push_back(swapped(static_cast<std::uint32_t>((cycle / kCyclesPerSecond % 8) << 13U |
                                                          cycle % kCyclesPerSecond)));
  if (!buffer.interrupts && headers_.size() * 4 < kHeaderPage) return;
  const auto late = static_cast<Nanoseconds>(share_of(cycle) * static_cast<double>(bus().jitter));
  const Nanoseconds when = bus().clock.host_at_cycle(cycle + 1) + late;
  tell_received(cycle, std::max(when, bus().interrupts_held_until));
}

void FireFile::tell_received(std::int64_t cycle, Nanoseconds when) {
  if (headers_.empty()) return;
  last_told_ = when = std::max(when, last_told_);  // in their order, however late
  fw_cdev_event_iso_interrupt event{};
  event.closure = context_closure_;
  event.type = FW_CDEV_EVENT_ISO_INTERRUPT;
  event.cycle =
      static_cast<std::uint32_t>((cycle / kCyclesPerSecond % 8) << 13U | cycle % kCyclesPerSecond);
  event.header_length = static_cast<std::uint32_t>(headers_.size() * 4);
  tell(event, when, headers_);
  headers_.clear();
}

}  // namespace wagonsight::device
