#include "iidc/pair_assembly.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace wagonsight {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr unsigned kCyclesPerSecond = 8000;

std::uint16_t next_stamp(std::uint16_t stamp) {
  const unsigned second = stamp >> 13U;
  const unsigned cycle = (stamp & 0x1fffU) + 1;
  return static_cast<std::uint16_t>(cycle < kCyclesPerSecond ? second << 13U | cycle
                                                             : (second + 1) % 8 << 13U);
}

std::uint16_t gray_at(const std::byte* bytes, int shift) {
  const auto high = std::to_integer<unsigned>(bytes[0]);
  return static_cast<std::uint16_t>((high << 8U | std::to_integer<unsigned>(bytes[1])) >> shift);
}

}  // namespace

PairAssembly::Step PairAssembly::add(const IsoPacket& packet, std::span<std::uint16_t> out) {
  Step step;
  const bool has_length = packet.length == shape_.packet_bytes &&
                          static_cast<int>(packet.payload.size()) == packet.length;
  const bool follows = packet.stamp == next_stamp(last_stamp_);
  last_stamp_ = packet.stamp;
  if (packet.length == 0) return step;  // a camera may send these where it has nothing to say
  if (packet.begins_image && has_length) {
    step.lost_one = is_open_ || has_orphans_;
    step.begins = is_open_ = is_good_ = true;
    has_orphans_ = false;
    count_ = 0;
  } else if (!is_open_) {
    has_orphans_ = true;
    return step;
  } else {
    is_good_ = is_good_ && has_length && follows && !packet.begins_image;
  }
  if (is_good_ && !out.empty()) copy(packet.payload, out);
  if (++count_ < shape_.packets) return step;
  is_open_ = false;
  step.completes = is_good_;
  step.lost_one = step.lost_one || !is_good_;
  return step;
}

void PairAssembly::copy(std::span<const std::byte> payload, std::span<std::uint16_t> out) const {
  const std::size_t at =
      static_cast<std::size_t>(count_) * static_cast<std::size_t>(shape_.packet_bytes) / 2;
  // The last packet is filled up with what belongs to no pixel.
  const std::size_t count = std::min(payload.size() / 2, out.size() - std::min(at, out.size()));
  if (shape_.layout == PairLayout::kLeftAboveRight) {
    for (std::size_t i = 0; i < count; ++i) out[at + i] = gray_at(&payload[2 * i], shape_.shift);
    return;
  }
  const auto width = static_cast<std::size_t>(shape_.width);
  const std::size_t pixels = width * static_cast<std::size_t>(shape_.height);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t row = (at + i) / (2 * width);
    const std::size_t column = (at + i) % (2 * width);
    const bool is_right = column >= width;
    out[(is_right ? pixels : 0) + row * width + (is_right ? column - width : column)] =
        gray_at(&payload[2 * i], shape_.shift);
  }
}

}  // namespace wagonsight
