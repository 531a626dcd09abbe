#pragma once

#include <cstdint>

namespace wagonsight {

// Isochronous bandwidth of a bus in the units of IEEE 1394: one is the time of a quadlet at 1600
// Mbit/s. Four fifths of a cycle of 125 us may be reserved.
inline constexpr int kFireUnitsOfBus = 4915;
inline constexpr int kFireCyclesPerSecond = 8000;

// What a packet with so many bytes of image reserves at 400 Mbit/s: its quadlets, and three of
// header and checksums, four units each. As libdc1394 counts.
constexpr int fire_units(int packet_bytes) {
  return (packet_bytes / 4 + 3) * 4;
}

struct PacketWish {
  std::int64_t image_bytes = 0;
  int cameras_on_bus = 1;       // that share it alike
  double rate_hz_max = 0;       // no faster than this is needed; 0: as fast as the bus allows
  int unit_bytes = 4;           // a packet is a multiple of it
  int packet_bytes_max = 4096;  // of the camera
};

struct PacketPlan {
  int packet_bytes = 0;  // 0: it does not fit
  int packets = 0;       // of an image
  int units = 0;         // of bandwidth
  double rate_hz = 0;    // at most
};

// The packets of one camera such that all cameras of its bus fit beside each other.
PacketPlan plan_packets(const PacketWish& wish);

}  // namespace wagonsight
