#include "iidc_unit.h"

#include <linux/firewire-constants.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace wagonsight::device {
namespace {

// Where its registers lie, from 0xfffff0000000.
constexpr std::uint64_t kRom = 0x400, kCommands = 0xf00000, kFormat7 = 0xf10000;
constexpr std::uint64_t kShutterAbsolute = 0xf20000, kGainAbsolute = 0xf20100;
// Command registers.
constexpr std::uint64_t kInitialise = 0x000, kIsoEnable = 0x614, kSoftTrigger = 0x62c;
constexpr std::uint64_t kShutter = 0x81c, kGain = 0x820, kTrigger = 0x830, kFrameInfo = 0x12f8;
// Format7 registers.
constexpr std::uint64_t kPacketBytes = 0x044, kPacketsPerFrame = 0x048, kTotalHigh = 0x038,
                        kTotalLow = 0x03c, kValueSetting = 0x07c;
constexpr std::uint32_t kPresent = 0x80000000, kOn = 0x02000000, kAbsolute = 0x40000000;
constexpr std::uint32_t kCounterInImage = 0x40;
constexpr std::int64_t kCyclesOfTimer = 128 * 8000;

std::uint64_t mix(std::uint64_t x) {  // splitmix64
  x += 0x9E3779B97F4A7C15ULL;
  x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27U)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31U);
}
double chance(std::uint64_t seed) {
  return static_cast<double>(mix(seed) >> 11U) * 0x1p-53;
}
std::uint32_t bits_of(double value) {
  return std::bit_cast<std::uint32_t>(static_cast<float>(value));
}
double value_of(std::uint32_t bits) {
  return static_cast<double>(std::bit_cast<float>(bits));
}
bool is_within(std::uint64_t offset, std::uint64_t begin, std::uint64_t bytes) {
  return offset >= begin && offset < begin + bytes;
}

}  // namespace

IidcUnit::IidcUnit(Options options)
    : options_(std::move(options)), gray_(kPixels), wire_(kBytes + 8192) {
  initialise();
}

std::vector<std::uint32_t> IidcUnit::config_rom() const {
  std::vector<std::uint32_t> rom = {0x04040000,
                                    0x31333934,
                                    0xf000a102,
                                    static_cast<std::uint32_t>(options_.guid >> 32U),
                                    static_cast<std::uint32_t>(options_.guid),
                                    0x00020000,
                                    0x0300b09d,
                                    0xd1000001,  // root: vendor, unit at 8
                                    0x00040000,
                                    0x1200a02d,
                                    0x13000102,
                                    0xd4000002,
                                    0x17000017,  // IIDC; dependent part at 13
                                    0x00040000,
                                    0x40000000 | kCommands / 4,
                                    0x81000003,
                                    0x82000006,
                                    0x38000010,  // IIDC 1.31
                                    0x00030000,
                                    0,
                                    0,
                                    0x46414b45,  // at 18: "FAKE"
                                    0x00040000,
                                    0,
                                    0,
                                    0x53544552,
                                    0x454f0000};  // at 22: "STEREO"
  if (options_.rom == Rom::kNoCamera) rom[9] = 0x12000123;
  if (options_.rom == Rom::kEmptyLeaf) rom[18] = 0;
  if (options_.rom == Rom::kBeyondItsEnd) rom[15] = 0x81000080;
  return rom;
}

// ---- registers

void IidcUnit::initialise() {
  registers_ = {};
  const auto set = [this](std::uint64_t offset, std::uint32_t value) {
    registers_[offset / 4] = value;
  };
  set(0x100, 0x01000000);  // Format7
  set(0x19c, 0x80000000);  // its mode 0
  set(0x2e0, kFormat7 / 4);
  set(0x400, 0x00011800);  // power, one shot, multi shot
  set(0x404, 0x01880000);  // shutter, gain, trigger
  const std::uint32_t absolute = options_.has_absolute ? kAbsolute : 0;
  set(0x51c, kPresent | absolute | 0x0b000fff);
  set(0x520, kPresent | absolute | 0x0b0003ff);
  set(0x530, 0x8d818001);
  set(0x71c, kShutterAbsolute / 4);
  set(0x720, kGainAbsolute / 4);
  set(kShutter, kPresent | kOn | 0x01000064);  // by itself, until told otherwise
  set(kGain, kPresent | kOn | 0x01000000);
  set(kTrigger, kPresent);
  set(0x60c, 0x02000000);  // S400
  set(0x630, 0x0c000000);  // 12 bits
  if (options_.has_counter) set(kFrameInfo, kPresent);
  format7_ = {};
  format7_[0x00 / 4] = kWidth << 16 | 2 * kHeight;
  format7_[0x04 / 4] = 1 << 16 | 2;
  format7_[0x0c / 4] = kWidth << 16 | 2 * kHeight;
  format7_[0x10 / 4] = 5 << 24;     // 16 bits
  format7_[0x14 / 4] = 0x84000000;  // 8 or 16
  format7_[0x34 / 4] = kPixels;
  format7_[0x40 / 4] = 4 << 16 | static_cast<std::uint32_t>(options_.packet_bytes_max);
  format7_[0x54 / 4] = 12 << 24;
  format7_[kValueSetting / 4] = kPresent;
  write_format7(kPacketBytes, static_cast<std::uint32_t>(options_.packet_bytes_max) << 16U);
  planned_.clear();
  faults.silent = false;
}

void IidcUnit::power_cycle() {
  initialise();
  faults.wedged = false;
  shutter_s_ = 0.002;
  gain_db_ = 0;
}

void IidcUnit::bus_was_reset() {
  faults.wedged = false;
}

int IidcUnit::read(std::uint64_t offset, std::uint32_t& quadlet) {
  if (faults.wedged) return kNoAnswer;
  if (faults.busy_requests > 0) return --faults.busy_requests, RCODE_BUSY;
  if (faults.refused_requests > 0) return --faults.refused_requests, RCODE_ADDRESS_ERROR;
  const auto rom = config_rom();
  if (is_within(offset, kRom, rom.size() * 4)) {
    quadlet = rom[(offset - kRom) / 4];
  } else if (is_within(offset, kCommands, sizeof registers_)) {
    quadlet = registers_[(offset - kCommands) / 4];
  } else if (is_within(offset, kFormat7, sizeof format7_)) {
    quadlet = format7_[(offset - kFormat7) / 4];
  } else if (is_within(offset, kShutterAbsolute, 12)) {
    const std::uint32_t values[] = {bits_of(20e-6), bits_of(0.06), bits_of(shutter_s_)};
    quadlet = values[(offset - kShutterAbsolute) / 4];
  } else if (is_within(offset, kGainAbsolute, 12)) {
    const std::uint32_t values[] = {bits_of(0), bits_of(18), bits_of(gain_db_)};
    quadlet = values[(offset - kGainAbsolute) / 4];
  } else {
    return RCODE_ADDRESS_ERROR;
  }
  return RCODE_COMPLETE;
}

int IidcUnit::write(std::uint64_t offset, std::uint32_t value) {
  if (faults.wedged) return kNoAnswer;
  if (faults.busy_requests > 0) return --faults.busy_requests, RCODE_BUSY;
  if (faults.refused_requests > 0) return --faults.refused_requests, RCODE_ADDRESS_ERROR;
  if (is_within(offset, kCommands, sizeof registers_))
    write_register(offset - kCommands, value);
  else if (is_within(offset, kFormat7, sizeof format7_))
    write_format7(offset - kFormat7, value);
  else if (offset == kShutterAbsolute + 8)
    shutter_s_ = std::clamp(value_of(value), 20e-6, 0.06);
  else if (offset == kGainAbsolute + 8)
    gain_db_ = std::clamp(value_of(value), 0.0, 18.0);
  else
    return RCODE_ADDRESS_ERROR;
  return RCODE_COMPLETE;
}

void IidcUnit::write_register(std::uint64_t offset, std::uint32_t value) {
  if (offset == kInitialise && value >> 31U != 0) return initialise();
  if (offset == kSoftTrigger) {
    if (value >> 31U != 0) pulse();
    return;
  }
  registers_[offset / 4] = offset == kFrameInfo && options_.has_counter ? value | kPresent : value;
  if (offset == kIsoEnable || offset == kTrigger) planned_.clear();
}

void IidcUnit::write_format7(std::uint64_t offset, std::uint32_t value) {
  if (offset == kValueSetting) {
    const bool never = faults.endless_handshake && (value & kAbsolute) != 0;
    format7_[offset / 4] = never ? kPresent | kAbsolute : kPresent;
    return;
  }
  format7_[offset / 4] = value;
  if (offset != kPacketBytes || value >> 16U == 0) return;
  packet_bytes_ = static_cast<int>(value >> 16U);
  format7_[kPacketsPerFrame / 4] = static_cast<std::uint32_t>(packets());
  format7_[kTotalHigh / 4] = 0;
  format7_[kTotalLow / 4] = static_cast<std::uint32_t>(packets() * packet_bytes_);
}

// ---- when it exposes

bool IidcUnit::sends() const {
  return registers_[kIsoEnable / 4] >> 31U != 0 && !faults.silent && !faults.wedged;
}
bool IidcUnit::is_triggered() const {
  return (registers_[kTrigger / 4] & kOn) != 0;
}
bool IidcUnit::counts_frames() const {
  return (registers_[kFrameInfo / 4] & kCounterInImage) != 0;
}
int IidcUnit::packets() const {
  return (static_cast<int>(kBytes) + packet_bytes_ - 1) / packet_bytes_;
}

void IidcUnit::plan(std::int64_t first_cycle, Nanoseconds exposure_begin) {
  const auto exposure = static_cast<Nanoseconds>(shutter_s_ * 1e9);
  planned_.push_back(
      {{next_number_++, exposure_begin + exposure / 2, exposure, gain_db_}, first_cycle});
  last_first_cycle_ = first_cycle;
}

void IidcUnit::pulse() {
  if (!is_triggered() || !sends()) return;
  const Nanoseconds begin = VirtualTime::instance().now();
  const auto exposure = static_cast<Nanoseconds>(shutter_s_ * 1e9);
  const std::int64_t first = clock().cycle_at(begin + exposure + options_.readout) + 1;
  if (first < last_first_cycle_ + packets()) {
    ++triggers_missed_;
    return;
  }
  plan(first, begin);
  VirtualTime::instance().something_changed();
}

// The frames of its own rate that begin up to one period after `cycle`.
void IidcUnit::plan_free_frames(std::int64_t cycle) {
  if (!planned_.empty() || !sends() || is_triggered()) return;
  const double period_ns = std::max(1e9 / options_.rate_hz / (1.0 + options_.drift_ppm * 1e-6),
                                    static_cast<double>(packets()) * kCycle);
  const Nanoseconds earliest =
      clock().host_at_cycle(std::max(cycle, last_first_cycle_ + packets()));
  const double frame = std::ceil(static_cast<double>(earliest - options_.phase) / period_ns - 1e-9);
  const auto begin = options_.phase + static_cast<Nanoseconds>(frame * period_ns);
  const auto exposure = static_cast<Nanoseconds>(shutter_s_ * 1e9);
  const std::int64_t first = std::max(clock().cycle_at(begin) + 1, last_first_cycle_ + packets());
  plan(first, clock().host_at_cycle(first) - options_.readout - exposure);
}

// ---- what it sends

std::int64_t IidcUnit::next_packet(std::int64_t cycle) {
  if (!sends()) return kNoCycle;
  while (!planned_.empty() && planned_.front().first_cycle + packets() <= cycle)
    planned_.pop_front();
  plan_free_frames(cycle);
  return planned_.empty() ? kNoCycle : std::max(cycle, planned_.front().first_cycle);
}

void IidcUnit::render(const Planned& frame) {
  if (rendered_ == frame.taken.number) return;
  options_.feed(frame.taken, gray_);
  for (std::size_t i = 0; i < kPixels; ++i) {
    const auto swapped = static_cast<std::uint16_t>(gray_[i] << 8U | gray_[i] >> 8U);
    std::memcpy(&wire_[2 * i], &swapped, 2);
  }
  if (counts_frames())
    for (unsigned i = 0; i < 4; ++i)
      wire_[i] = static_cast<std::uint8_t>(frame.taken.number >> (24 - 8 * i));
  rendered_ = frame.taken.number;
}

FireDevice::Packet IidcUnit::isochronous(std::int64_t cycle, std::span<std::uint8_t> out) {
  const Planned& frame = planned_.front();
  const auto index = cycle - frame.first_cycle;
  const Taken& taken = frame.taken;
  if (index == 0 || sent_.empty() || sent_.back().number != taken.number)
    sent_.push_back({taken.number, frame.first_cycle, taken.light, taken.exposure, false, 0});
  if (out.empty()) return {};
  render(frame);
  const int length = faults.wrong_packet_size ? packet_bytes_ - 4 : packet_bytes_;
  const auto count = std::min(out.size(), static_cast<std::size_t>(length));
  std::memcpy(out.data(),
              &wire_[static_cast<std::size_t>(index) * static_cast<std::size_t>(packet_bytes_)],
              count);
  const int channel = static_cast<int>(registers_[0x60c / 4] >> 28U);
  const Packet meant{channel, length, index == 0 ? 1U : 0U};
  const Packet packet = damage(cycle, meant, out);
  Sent& sent = sent_.back();
  if (packet.channel == channel && packet.length == packet_bytes_ && packet.sy == meant.sy)
    sent.whole = ++sent.good_packets == packets();
  return packet;
}

FireDevice::Packet IidcUnit::damage(std::int64_t cycle, Packet packet,
                                    std::span<std::uint8_t> out) {
  const auto seed = static_cast<std::uint64_t>(cycle) * 4 ^ mix(options_.guid);
  if (chance(seed) < faults.lost) return {};
  if (chance(seed + 1) < faults.truncated) {
    packet.length = static_cast<int>(mix(seed) % static_cast<std::uint64_t>(packet.length));
  } else if (chance(seed + 2) < faults.garbage) {
    packet.length = static_cast<int>(mix(seed) % static_cast<std::uint64_t>(packet.length));
    packet.sy = static_cast<unsigned>(mix(seed + 3) % 16);
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = static_cast<std::uint8_t>(mix(seed + i));
  }
  return packet;
}

const IidcUnit::Sent* IidcUnit::frame_of_ticks(std::uint64_t ticks) const {
  const auto cycle = static_cast<std::int64_t>(ticks / 3072) % kCyclesOfTimer;
  const auto found = std::find_if(sent_.rbegin(), sent_.rend(), [&](const Sent& frame) {
    return frame.first_cycle % kCyclesOfTimer == cycle;
  });
  return found == sent_.rend() ? nullptr : &*found;
}

void paint_stereo_pattern(unsigned unit, std::uint32_t number, std::span<std::uint16_t> gray) {
  const std::uint32_t base = number * 29 + unit * 311;
  for (std::uint32_t i = 0; i < gray.size(); ++i)
    gray[i] = static_cast<std::uint16_t>((base + i * 7 + (i >> 9U) * 13) & 0xfffU);
}

}  // namespace wagonsight::device
