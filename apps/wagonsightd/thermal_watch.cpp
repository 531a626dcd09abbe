#include "thermal_watch.h"

#include <fmt/format.h>

#include "linux/temperatures.h"

namespace wagonsight {
namespace {

constexpr double kPeriodS = 2.0;  // a heat sink takes tens of seconds

double limit_of(ThermalBand band, const ThermalSettings& settings) {
  switch (band) {
    case ThermalBand::kNormal:
      return 0;
    case ThermalBand::kWarm:
      return settings.warm_hz;
    case ThermalBand::kHot:
      break;
  }
  return settings.hot_hz;
}

}  // namespace

ThermalBand next_band(ThermalBand band, double celsius, const ThermalSettings& settings) {
  const auto reaches = [&](ThermalBand wanted, double begin_c) {
    return celsius >= (band >= wanted ? begin_c - settings.hysteresis_c : begin_c);
  };
  if (reaches(ThermalBand::kHot, settings.hot_c)) return ThermalBand::kHot;
  return reaches(ThermalBand::kWarm, settings.warm_c) ? ThermalBand::kWarm : ThermalBand::kNormal;
}

ThermalWatch::ThermalWatch(const ThermalSettings& settings, Tell tell)
    : settings_(settings), tell_(std::move(tell)) {}

bool ThermalWatch::tick(double now_s) {
  if (now_s < next_s_) return false;
  next_s_ = now_s + kPeriodS;
  ThermalStatus now;
  now.band = ThermalBand::kNormal;
  read_temperatures(settings_.folder, [&](std::string_view zone, double celsius) {
    if (now.present && celsius <= now.hottest_c) return;
    now.present = true;
    now.hottest_c = celsius;
    now.zone = zone.substr(0, Name::capacity());
  });
  // Zones that cannot be read for once say nothing; what was known goes on.
  if (!now.present) return false;
  now.band = next_band(status_.band, now.hottest_c, settings_);
  now.rate_limit_hz = limit_of(now.band, settings_);
  const ThermalBand before = status_.band;
  status_ = now;
  if (before != now.band) log_change(before);
  return true;
}

void ThermalWatch::log_change(ThermalBand before) const {
  const std::string where =
      fmt::format("{} has {:.0f} degrees Celsius", status_.zone.view(), status_.hottest_c);
  if (status_.band == ThermalBand::kNormal)
    tell_(Severity::kNote, fmt::format("{}: every instant is worked on again.", where));
  else
    tell_(status_.band > before ? Severity::kWarning : Severity::kNote,
          fmt::format("{}: at most {:.0f} instants a second are worked on.", where,
                      status_.rate_limit_hz));
}

}  // namespace wagonsight
