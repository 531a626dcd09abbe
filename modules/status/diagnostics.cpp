#include "status/diagnostics.h"

#include "status/answers.h"
#include "status/metrics.h"
#include "status/zip.h"

namespace wagonsight {

std::string diagnostics_zip(const StatusInput& input, const Health& health) {
  const auto pretty = [](const answers::Json& value) {
    return value.dump(2, ' ', false, answers::Json::error_handler_t::replace) + "\n";
  };
  std::vector<ZipEntry> entries = {
      {"health.json", pretty(answers::health(input, health))},
      {"version.json", pretty(answers::version(*input.unit))},
      {"plan.json", pretty(answers::plan(*input.unit))},
      {"settings.toml", std::string(input.unit->settings.view())},
      {"metrics.txt", metrics_text(input, health)},
  };
  if (input.log != nullptr) entries.push_back({"log.json", pretty(answers::log(*input.log))});
  double unix_time = 0;
  if (input.snapshot != nullptr) {
    const Snapshot& snapshot = *input.snapshot;
    unix_time = snapshot.unix_time;
    entries.push_back({"sensors.json", pretty(answers::sensors(snapshot))});
    entries.push_back({"pipeline.json", pretty(answers::pipeline(snapshot))});
    entries.push_back({"calibration.json", pretty(answers::calibration(snapshot))});
    entries.push_back({"occupancy.json", pretty(answers::occupancy(snapshot))});
  }
  return make_zip(entries, unix_time);
}

}  // namespace wagonsight
