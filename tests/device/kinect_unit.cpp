#include "kinect_unit.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>

namespace wagonsight::device {
namespace {

constexpr double kFramesPerSecond = 30.0;
constexpr double kTicksPerSecond = 60e6;
constexpr double kMicroframe_s = 125e-6;
constexpr std::uint8_t kDepthEndpoint = 0x82;
constexpr int kHeaderBytes = 12;
constexpr int kPayloadBytes = 1748;
constexpr int kFrameBytes = KinectUnit::kPixels * 11 / 8;
constexpr int kPackets = (kFrameBytes + kPayloadBytes - 1) / kPayloadBytes;  // 242

std::uint64_t mix(std::uint64_t x) {  // splitmix64
  x += 0x9E3779B97F4A7C15ULL;
  x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27U)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31U);
}
double chance(std::uint64_t seed) {
  return static_cast<double>(mix(seed) >> 11U) * 0x1p-53;
}

unsigned word(std::span<const std::uint8_t> bytes, std::size_t at) {
  return bytes[at] | static_cast<unsigned>(bytes[at + 1]) << 8U;
}
void put_word(std::vector<std::uint8_t>& bytes, std::size_t at, unsigned value) {
  bytes[at] = static_cast<std::uint8_t>(value);
  bytes[at + 1] = static_cast<std::uint8_t>(value >> 8U);
}
void put_float(std::vector<std::uint8_t>& bytes, std::size_t at, float value) {
  std::memcpy(&bytes[at], &value, sizeof value);
}

}  // namespace

KinectUnit::KinectUnit(Options options)
    : options_(std::move(options)),
      raw_(kPixels),
      pictures_(std::max(options_.repeats_after, 1U)) {}

UsbDevice::Identity KinectUnit::identity() const {
  return {0x045e, 0x02ae, options_.version, options_.serial, options_.speed_mbit};
}

std::vector<std::uint8_t> KinectUnit::descriptors() const {
  const auto low = static_cast<std::uint8_t>(options_.version);
  const auto high = static_cast<std::uint8_t>(options_.version >> 8U);
  std::vector<std::uint8_t> bytes = {18,   1,    0,    2,   0,    0, 0, 64, 0x5e,
                                     0x04, 0xae, 0x02, low, high, 2, 1, 3,  1};
  const std::uint8_t endpoints = faults.wrong_configuration ? 0 : 2;
  const auto total = static_cast<std::uint8_t>(9 + 9 + 7 * endpoints);
  for (const int byte : {9, 2, int{total}, 0, 1, 1, 0, 0xc0, 8})
    bytes.push_back(static_cast<std::uint8_t>(byte));
  for (const int byte : {9, 4, 0, 0, int{endpoints}, 0xff, 0xff, 0xff, 0})
    bytes.push_back(static_cast<std::uint8_t>(byte));
  for (int i = 0; i < endpoints; ++i)
    for (const int byte : {7, 5, 0x81 + i, 1, 0xc0, 0x0b, 1})
      bytes.push_back(static_cast<std::uint8_t>(byte));
  return bytes;
}

// ---- time

std::int64_t KinectUnit::first_microframe(std::uint32_t number) const {
  const double at_s =
      static_cast<double>(number) / kFramesPerSecond / (1.0 + options_.drift_ppm * 1e-6) +
      static_cast<double>(options_.phase) * 1e-9;
  return static_cast<std::int64_t>(std::ceil(at_s / kMicroframe_s));
}

std::uint32_t KinectUnit::frame_at(std::int64_t microframe) const {
  const double device_s = (static_cast<double>(microframe) * kMicroframe_s -
                           static_cast<double>(options_.phase) * 1e-9) *
                          (1.0 + options_.drift_ppm * 1e-6);
  auto number = static_cast<std::uint32_t>(std::max(device_s * kFramesPerSecond, 1.0));
  while (first_microframe(number) > microframe) --number;
  while (first_microframe(number + 1) <= microframe) ++number;
  return number;
}

std::uint32_t KinectUnit::ticks_at(std::int64_t microframe) const {
  const double device_s =
      static_cast<double>(microframe) * kMicroframe_s * (1.0 + options_.drift_ppm * 1e-6) +
      jumped_s_;
  const auto ticks = static_cast<std::uint64_t>(device_s * kTicksPerSecond);
  return static_cast<std::uint32_t>(ticks + options_.first_ticks);
}

Nanoseconds KinectUnit::light_of(std::uint32_t number) const {
  return first_microframe(number) * kMicroframe;
}

std::uint32_t KinectUnit::frame_of_ticks(std::uint64_t ticks, Nanoseconds now) const {
  const std::int64_t microframe = now / kMicroframe;
  const std::uint32_t behind = ticks_at(microframe) - static_cast<std::uint32_t>(ticks);
  const double behind_s = behind / kTicksPerSecond / (1.0 + options_.drift_ppm * 1e-6);
  return frame_at(microframe - static_cast<std::int64_t>(std::lround(behind_s / kMicroframe_s)));
}

Nanoseconds KinectUnit::lateness(std::int64_t microframe) {
  if (options_.jitter == 0) return 0;
  const auto seed = static_cast<std::uint64_t>(microframe) ^ options_.first_ticks;
  return static_cast<Nanoseconds>(chance(seed) * static_cast<double>(options_.jitter));
}

// ---- requests

int KinectUnit::control(const Setup& setup, std::span<std::uint8_t> data) {
  if (faults.wedged) return kNoAnswer;
  if (setup.request_type == 0x80 && setup.request == 6 && setup.value >> 8U == 3)
    return string_descriptor(setup.value & 0xffU, data);
  if (faults.stalled_requests > 0) {
    --faults.stalled_requests;
    return -EPIPE;
  }
  if (setup.request_type == 0x40 && setup.request == 0) return take_command(data);
  if (setup.request_type == 0xc0 && setup.request == 0) return give_reply(data);
  return -EPIPE;
}

int KinectUnit::string_descriptor(int index, std::span<std::uint8_t> out) const {
  std::vector<std::uint8_t> bytes = {4, 3, 9, 4};  // the languages: English
  if (index != 0) {
    const std::string text = index == 3 ? options_.serial : "Xbox NUI Camera";
    bytes = {static_cast<std::uint8_t>(2 + 2 * text.size()), 3};
    for (const char c : text) {
      bytes.push_back(static_cast<std::uint8_t>(c));
      bytes.push_back(0);
    }
  }
  const std::size_t count = std::min(bytes.size(), out.size());
  std::copy_n(bytes.begin(), count, out.begin());
  return static_cast<int>(count);
}

int KinectUnit::take_command(std::span<const std::uint8_t> message) {
  const bool is_command = message.size() >= 10 && message[0] == 'G' && message[1] == 'M' &&
                          word(message, 2) * 2 + 8 == message.size();
  if (!is_command) return -EPIPE;
  const unsigned command = word(message, 4);
  const unsigned tag = word(message, 6);
  const auto arguments = message.subspan(8);
  std::vector<std::uint8_t> body;
  if (command == 0x02) {  // read a register
    body.resize(4);
    put_word(body, 2, registers_[word(arguments, 0) & 0x3ffU]);
  } else if (command == 0x03 && arguments.size() >= 4) {  // write one
    body.resize(2);
    write_register(word(arguments, 0), word(arguments, 2));
  } else if (command == 0x04) {  // the optics
    body.resize(322);
    put_float(body, 94, options_.optics.emitter_distance_cm);
    put_float(body, 98, options_.optics.color_distance_cm);
    put_float(body, 102, options_.optics.reference_distance_cm);
    put_float(body, 106, options_.optics.reference_pixel_cm);
  } else if (command == 0x16) {  // how depth and colour are registered
    const unsigned what = word(arguments, 0);
    body.resize(what == 0x40 ? 118 : what == 0x41 ? 8 : 4);
    if (what == 0) put_word(body, 2, options_.optics.shift);
  } else {
    return -EPIPE;
  }
  reply_ = {'R', 'B', 0, 0, 0, 0, 0, 0};
  put_word(reply_, 2, static_cast<unsigned>(body.size() / 2));
  put_word(reply_, 4, command);
  put_word(reply_, 6, faults.foreign_replies ? tag + 1 : tag);
  reply_.insert(reply_.end(), body.begin(), body.end());
  return static_cast<int>(message.size());
}

int KinectUnit::give_reply(std::span<std::uint8_t> out) {
  if (faults.empty_replies) return 0;
  const std::size_t count = std::min(reply_.size(), out.size());
  std::copy_n(reply_.begin(), count, out.begin());
  reply_.clear();
  return static_cast<int>(count);
}

void KinectUnit::write_register(unsigned number, unsigned value) {
  registers_[number & 0x3ffU] = static_cast<std::uint16_t>(value);
  if (number != 0x06) return;
  running_ = value == 2;
  in_frame_ = false;
}

void KinectUnit::reset() {
  running_ = in_frame_ = faults.silent = false;
  if (!faults.wedge_outlives_reset) faults.wedged = false;
}

void KinectUnit::power_cycle() {
  running_ = in_frame_ = false;
  faults.wedged = faults.wedge_outlives_reset = false;
}

// ---- depth

std::uint16_t KinectUnit::millimetres(std::uint16_t raw) const {
  // Half-pixel disparities against a reference plane (Khoshelham and Elberink, Sensors 2012, eq.
  // 4), in the units of the camera's own parameters: 4 steps a pixel, centimetres.
  const Optics& o = options_.optics;
  const double pixels = (raw - 4.0 * o.shift) / 4.0 - 0.375;
  const double shift_cm = pixels * static_cast<double>(o.reference_pixel_cm);
  const double emitter_cm = o.emitter_distance_cm;
  const double reference_cm = o.reference_distance_cm;
  if (raw == kNoReading || shift_cm >= emitter_cm) return 0;
  const double depth_mm = 10.0 * (shift_cm * reference_cm / (emitter_cm - shift_cm) + reference_cm);
  return depth_mm > 0 && depth_mm < 10'000 ? static_cast<std::uint16_t>(depth_mm) : 0;
}

const std::vector<std::uint8_t>& KinectUnit::packed(std::uint32_t number) {
  const bool repeats = options_.repeats_after != 0;
  Picture& picture = pictures_[number % pictures_.size()];
  if (picture.number == number || (repeats && picture.number >= 0)) return picture.packed;
  options_.feed(number, light_of(number), raw_);
  picture.number = number;
  picture.packed.resize(static_cast<std::size_t>(kPackets) * kPayloadBytes);
  std::uint8_t* out = picture.packed.data();
  std::uint64_t bits = 0;
  unsigned held = 0;
  for (const std::uint16_t raw : raw_) {
    bits = bits << 11U | (raw & 0x7ffU);
    for (held += 11; held >= 8; held -= 8) *out++ = static_cast<std::uint8_t>(bits >> (held - 8));
  }
  return picture.packed;
}

UsbDevice::IsoPacket KinectUnit::isochronous(std::uint8_t endpoint, std::int64_t microframe,
                                             std::span<std::uint8_t> out) {
  if (endpoint != kDepthEndpoint || !running_ || faults.silent || faults.wedged) return {};
  const std::uint32_t number = frame_at(microframe);
  const auto index = microframe - first_microframe(number);
  if (index == 0) {
    in_frame_ = true;
    good_packets_ = 0;
    sent_.push_back({number, false});
  }
  if (!in_frame_ || index >= kPackets) return {};
  const int at = static_cast<int>(index) * kPayloadBytes;
  const int payload = std::min(kFrameBytes - at, kPayloadBytes);
  const bool is_last = index == kPackets - 1;
  const std::uint32_t ticks = ticks_at(microframe);
  // The sequence follows the place on the wire: who does not fetch a packet sees a gap.
  const auto sequence = static_cast<std::uint8_t>(number * kPackets + index);
  const std::uint8_t header[8] = {
      'R', 'B',      0, static_cast<std::uint8_t>(0x70 | (index == 0 ? 1 : is_last ? 5 : 2)),
      0,   sequence, 0, 0};
  std::memcpy(out.data(), header, sizeof header);
  std::memcpy(&out[8], &ticks, sizeof ticks);
  std::memcpy(&out[kHeaderBytes], &packed(number)[static_cast<std::size_t>(at)],
              static_cast<std::size_t>(payload));
  const IsoPacket packet = damage(microframe, {kHeaderBytes + payload, 0}, out);
  if (packet.status == 0 && packet.length == kHeaderBytes + payload && out[0] == 'R')
    ++good_packets_;
  if (is_last && sent_.back().number == number) sent_.back().whole = good_packets_ == kPackets;
  return packet;
}

UsbDevice::IsoPacket KinectUnit::damage(std::int64_t microframe, IsoPacket packet,
                                        std::span<std::uint8_t> out) {
  const auto seed = static_cast<std::uint64_t>(microframe) * 4 ^ options_.first_ticks;
  if (chance(seed) < faults.lost) return {};
  if (chance(seed + 1) < faults.truncated) {
    packet.length = static_cast<int>(mix(seed) % static_cast<std::uint64_t>(packet.length));
    return packet;
  }
  const bool is_garbage = chance(seed + 2) < faults.garbage;
  const bool is_corrupted = chance(seed + 3) < faults.corrupted;
  if (is_garbage)
    for (int i = 0; i < packet.length; ++i)
      out[static_cast<std::size_t>(i)] =
          static_cast<std::uint8_t>(mix(seed + static_cast<unsigned>(i)) | 1U);
  if (is_corrupted) {
    for (std::size_t i = kHeaderBytes; i < static_cast<std::size_t>(packet.length); i += 3)
      out[i] = static_cast<std::uint8_t>(out[i] ^ 0x55U);
    packet.status = -EILSEQ;
  }
  return packet;
}

void paint_test_pattern(unsigned unit, std::uint32_t number, std::span<std::uint16_t> raw) {
  const std::uint32_t base = number * 29 + unit * 311;
  for (std::uint32_t i = 0; i < raw.size(); ++i)
    raw[i] = static_cast<std::uint16_t>((base + i * 7 + (i >> 9U) * 13) & 0x7ffU);
}

}  // namespace wagonsight::device
