#pragma once

#include "foreground/extractor.h"
#include "fusion/fused_cloud.h"
#include "fusion/visibility.h"
#include "people/describe.h"
#include "people/detect.h"
#include "people/track.h"
#include "people/upright_shapes.h"
#include "pipeline/pipeline.h"
#include "situation/situation.h"

namespace wagonsight {

// One sensor's way from its image to its foreground.
struct SensorLane {
  std::unique_ptr<StereoToDepth> stereo;  // of a stereo camera only
  FrameSlot depth_slot;                   // its depth in the form of a depth sensor's frame
  HostTime learned_at{};                  // when its whole image was matched for the background
  std::unique_ptr<ForegroundExtractor> extractor;
  std::unique_ptr<Foreground> foreground;
  std::array<Duration, 2> took{};  // to depth and to extract, at this instant
};

// What one worker writes in while it is at one sensor's part; nothing of it lasts until the next.
struct WorkerSpace {
  std::shared_ptr<BlobWorkspace> blobs;
  std::vector<std::unique_ptr<StereoWorkspace>> stereo;  // one for each size of images
  BoundedVector<PixelRect> regions;  // of the last FrameSet's tracks and foreground

  explicit WorkerSpace(double voxel_m);
  // Of that size; nullptr: there is none.
  StereoWorkspace* stereo_of(const Camera& camera) const;
};

// Everything the pipeline keeps between two instants. Private to its sources.
struct Pipeline::State {
  State(const Rig& the_rig, const Wagon& wagon, const PipelineOptions& the_options);

  // The steps of process(), in their order.
  void begin(const FrameSet& frames);
  void watch(const FrameSet& frames);
  void fuse(const FrameSet& frames);
  void find_people(const FrameSet& frames);
  void judge_situation();

  // The steps of one sensor's part of an instant. They write what is the sensor's own, and `space`.
  void to_depth(std::size_t sensor_index, const SensorFrame& taken, WorkerSpace& space);
  void extract(std::size_t sensor_index, WorkerSpace& space);

  void order_parts();
  Result<void> add_stereo(std::size_t sensor_index, RayTable rays, const Wagon& wagon);
  SensorFrame matched(std::size_t sensor_index, const SensorFrame& frame, bool whole,
                      WorkerSpace& space);
  bool learns_from(std::size_t sensor_index, const SensorFrame& pair);
  void gather_regions(std::size_t sensor_index, BoundedVector<PixelRect>& regions) const;
  void gather_motion_hints();
  void tell_people();
  Duration ticks() const { return ticker != nullptr ? ticker() : Duration{}; }
  void finish_stage(Stage stage);

  Rig rig;
  PipelineOptions options;
  std::vector<std::vector<PixelRay>> own_rays;
  std::array<RayTable, kSensorsMax> all_rays;  // the blob's and own_rays
  std::vector<WorkerSpace> spaces;             // one for each worker
  std::array<SensorLane, kSensorsMax> lanes;
  FixedVector<std::size_t, kSensorsMax> parts;  // sensors, those first that take longest
  FrameSet depth;                               // the frames of this instant, all of them of depth
  std::array<ForegroundView, kSensorsMax> views{};
  FixedVector<MotionHint, kTracksMax> hints;  // the last FrameSet's tracks

  Fusion fusion;
  VisibilityGrid visibility;
  std::unique_ptr<UprightShapes> upright_shapes;  // only without a background
  Detector detector;
  Describer describer;
  Tracker tracker;
  Situation situation;

  const FusedCloud* cloud = nullptr;
  PeopleFrame frame;
  bool started = false;
  HostTime start{};
  DoorStates doors;

  Ticker ticker = nullptr;
  Duration stage_begin{};
  std::array<Duration, kStageCount> stage_times{};
};

// A frame of depth that is there, or nullptr.
inline const FrameSlot* depth_slot(const SensorFrame& frame) {
  if (frame.state != FrameState::kPresent || frame.slot == nullptr) return nullptr;
  return frame.slot->format == PixelFormat::kDepth16 ? frame.slot : nullptr;
}

}  // namespace wagonsight
