#pragma once

#include <functional>
#include <string>
#include <string_view>

namespace wagonsight {

// Calls `tell` with the name and the degrees Celsius of every thermal zone of a folder that is laid
// out as /sys/class/thermal: thermal_zoneN with `temp` (thousandths) and `type`. A zone that cannot
// be read, as of a part that is off, or tells what no computer survives is left out. Allocates; any
// thread.
void read_temperatures(const std::string& folder,
                       const std::function<void(std::string_view zone, double celsius)>& tell);

}  // namespace wagonsight
