#include "iidc/packet_plan.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace wagonsight {

PacketPlan plan_packets(const PacketWish& wish) {
  // A bus knows quadlets only.
  const int step = std::lcm(std::max(wish.unit_bytes, 1), 4);
  const int share = kFireUnitsOfBus / std::max(wish.cameras_on_bus, 1);
  int bytes = std::min(wish.packet_bytes_max, (share / 4 - 3) * 4);
  bytes -= bytes % step;
  if (wish.rate_hz_max > 0) {
    const double needed =
        static_cast<double>(wish.image_bytes) * wish.rate_hz_max / kFireCyclesPerSecond;
    bytes = std::min(bytes, static_cast<int>(std::ceil(needed / step)) * step);
  }
  if (bytes <= 0 || wish.image_bytes <= 0) return {};
  PacketPlan plan;
  plan.packet_bytes = bytes;
  plan.packets = static_cast<int>((wish.image_bytes + bytes - 1) / bytes);
  plan.units = fire_units(bytes);
  plan.rate_hz = static_cast<double>(kFireCyclesPerSecond) / plan.packets;
  return plan;
}

}  // namespace wagonsight
