#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "frame_source.h"
#include "linux/files.h"
#include "linux/workers.h"
#include "pipeline/pipeline.h"
#include "rig/ray_table.h"
#include "rig/rig.h"
#include "settings/settings.h"
#include "snapshot/snapshot.h"
#include "snapshot/unit_info.h"
#include "status/access.h"
#include "wagon/wagon.h"

namespace wagonsight {

// Everything that is known before the first frame: what the settings, the calibration and the
// scene or the recordings make of this unit.
struct Unit {
  Settings settings;
  std::string settings_text;                   // its secrets removed
  CheckedFile blob_file;                       // the ray tables may lie in it
  std::array<std::uint8_t, 32> blob_sha256{};  // zero without a blob
  std::vector<std::vector<PixelRay>> own_rays;
  Rig rig;
  std::array<RayTable, kSensorsMax> rays{};
  Wagon wagon;
  CalibrationStatus calibration;
  std::unique_ptr<Workers> workers;  // of the pipeline; not started
  std::unique_ptr<Pipeline> pipeline;
  std::vector<FrameSource> sources;  // their frames begin at `start`
  std::size_t slot_bytes = 0;
  std::vector<std::string> remarks;  // for the log
  bool simulated = false;
};

// Reads and checks the settings file alone.
Result<Settings> read_settings(const std::string& path,
                               std::string* text_without_secrets = nullptr);

// Whether the calibration and the recordings that the settings name are there and in order.
Result<void> check_named_files(const Settings& settings);

// `rig_path` overrides the settings' blob; empty: as in the settings. The Error is one sentence.
Result<std::unique_ptr<Unit>> assemble_unit(const std::string& settings_path,
                                            const std::string& rig_path, HostTime start);

UnitInfo unit_info(const Unit& unit, std::string_view version);
Result<AccessRules> access_rules(const WebSettings& web);

}  // namespace wagonsight
