#pragma once

#include "pipeline/pipeline.h"
#include "settings/settings.h"

namespace wagonsight {

// What the pipeline takes from a unit's settings file, for the daemon and for a replay alike.
PipelineOptions pipeline_options(const PipelineSettings& settings, const StereoSettings& stereo);

}  // namespace wagonsight
