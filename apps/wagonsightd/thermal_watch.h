#pragma once

#include <functional>
#include <string_view>

#include "settings/settings.h"
#include "snapshot/snapshot.h"
#include "snapshot/unit_info.h"

namespace wagonsight {

// Which band a temperature is in, given the one before: a band is left only `hysteresis_c` below
// where it begins, so that the rate does not swing.
ThermalBand next_band(ThermalBand band, double celsius, const ThermalSettings& settings);

// Reads the zones every two seconds and says how many instants a second may be worked on. One
// thread.
class ThermalWatch {
 public:
  using Tell = std::function<void(Severity, std::string_view)>;

  ThermalWatch(const ThermalSettings& settings, Tell tell);

  // To be called at least once a second. True when the status is another.
  bool tick(double now_s);
  const ThermalStatus& status() const { return status_; }

 private:
  void log_change(ThermalBand before) const;
  const ThermalSettings settings_;
  Tell tell_;
  ThermalStatus status_;
  double next_s_ = 0;
};

}  // namespace wagonsight
