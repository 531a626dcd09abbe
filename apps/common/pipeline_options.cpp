#include "common/pipeline_options.h"

namespace wagonsight {
namespace {

StereoToDepthOptions stereo_options(const StereoSettings& settings) {
  StereoToDepthOptions options;
  options.matcher.mode = settings.mode == "fast" ? MatcherMode::kFast : MatcherMode::kAccurate;
  options.matcher.disparity_count = settings.disparities;
  options.matcher.uniqueness_percent = settings.uniqueness_percent;
  options.matcher.texture_min = settings.texture_min;
  options.whole_every_s = settings.whole_every_s;
  options.aligned_every_s = settings.aligned_every_s;
  options.exposure.shutter_us_max = settings.shutter_us_max;
  options.exposure.gain_db_max = settings.gain_db_max;
  return options;
}

}  // namespace

PipelineOptions pipeline_options(const PipelineSettings& settings, const StereoSettings& stereo) {
  PipelineOptions options;
  options.leaf_m = settings.leaf_m;
  options.voxel_m = settings.voxel_m;
  options.noise_sigmas = settings.noise_sigmas;
  options.blob_area_min_m2 = settings.blob_area_min_m2;
  options.learning_s = settings.learning_s;
  options.fps_expected = settings.fps_expected;
  options.compensate_skew = settings.compensate_skew;
  options.stereo = stereo_options(stereo);
  return options;
}

}  // namespace wagonsight
