#include "wagon/wagon.h"

namespace wagonsight {

bool contains(const Zone& zone, const std::array<double, 2>& position) {
  bool inside = false;
  const std::size_t count = zone.polygon.size();
  for (std::size_t i = 0, before = count - 1; i < count; before = i++) {
    const auto& a = zone.polygon[i];
    const auto& b = zone.polygon[before];
    if ((a[1] > position[1]) == (b[1] > position[1])) continue;
    const double crossing = a[0] + (position[1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1]);
    if (position[0] < crossing) inside = !inside;
  }
  return inside;
}

}  // namespace wagonsight
