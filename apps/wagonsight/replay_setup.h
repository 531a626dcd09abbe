#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "base/result.h"
#include "files.h"
#include "pipeline/pipeline.h"
#include "recording_file.h"
#include "rig/ray_table.h"
#include "rig/rig.h"
#include "settings/settings.h"
#include "wagon/wagon.h"

namespace wagonsight {

// With what a recording is replayed: the rig (the recording's own, or a blob's), the room and the
// options (of the settings, or defaults that suit a recording by itself).
struct ReplaySetup {
  Rig rig;
  std::array<RayTable, kSensorsMax> rays{};
  Wagon wagon;
  PipelineOptions options;
  CaptureSettings capture;
  int workers = 0;                        // as ProcessingSettings
  bool had_pose = true;                   // before the floor was looked for
  std::uint64_t frame_count = 0;          // of all sensors together
  std::string remark;                     // what the user should know; else empty
  std::string floor_found;                // told where it was looked for
  std::string background_reason;          // why it is not learned, where the recording is too short
  std::unique_ptr<MappedFile> blob_file;  // what the rays may point into
};

// Paths may be empty: no settings, no blob. A single sensor without a pose is placed on the floor
// that the recording shows; the recording is read for that and rewound.
Result<ReplaySetup> set_up_replay(RecordingFile& recording, const std::string& config_path,
                                  const std::string& rig_path);

}  // namespace wagonsight
