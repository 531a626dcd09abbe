#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/part_runner.h"
#include "base/result.h"
#include "frame/frame.h"
#include "fusion/fused_cloud.h"
#include "rig/ray_table.h"
#include "rig/rig.h"
#include "snapshot/snapshot.h"
#include "stereo/stereo_to_depth.h"
#include "wagon/wagon.h"

namespace wagonsight {

// The user's choices for what is computed. Names carry units; the settings file has the same names.
struct PipelineOptions {
  double leaf_m = 0.02;            // of the background octree, 0.01 to 0.10
  double voxel_m = 0.02;           // of the foreground's voxel grid
  double noise_sigmas = 3.0;       // a change must exceed this many sigmas
  double blob_area_min_m2 = 0.01;  // smaller blobs are noise
  double learning_s = 2.0;         // until a background counts as known
  // The first background of a sensor is drawn up in about so many seconds, a few rows of each
  // frame, so that no instant costs more than a normal one; 0: from its first frame at once, for
  // recordings, where nothing is too late.
  double first_background_s = 0;
  double fps_expected = 30.0;  // FrameSets a second; time constants are seconds, this only warns
  bool compensate_skew = true;
  // For recordings of a few frames, from which no background can be learned: everything above the
  // floor is looked at, people are told from furniture by their shape and told at once.
  bool without_background = false;
  StereoToDepthOptions stereo;                     // of every stereo camera
  std::size_t evidence_nodes = kEvidenceNodesMax;  // a sensor's, for its background
  // Who does the sensors' parts of an instant, which changes no byte of what is told; it must
  // outlive the pipeline. nullptr: the caller of process() does them one after the other.
  PartRunner* runner = nullptr;
};

enum class Stage : std::uint8_t { kToDepth, kExtract, kFuse, kPeople, kSituation };
inline constexpr std::size_t kStageCount = 5;

// Algorithm 1 of the paper, and what follows from it: from the depth images of one instant to who
// is where. What concerns one sensor alone (to depth, extract) is done in parts by options.runner.
// One thread at a time; allocates only in the constructor.
class Pipeline {
 public:
  // `rays` by sensor index, as in the blob; they must outlive the pipeline. Where there are none
  // (a stereo camera's) they are made here. The Error of create() says what in the rig or the wagon
  // cannot be served (no sensor, an inside too large for the octree).
  static Result<std::unique_ptr<Pipeline>> create(const Rig& rig,
                                                  std::array<RayTable, kSensorsMax> rays,
                                                  const Wagon& wagon,
                                                  const PipelineOptions& options);
  // For a room that nobody chose: options.leaf_m becomes the finest leaf from its own on, up to 10
  // cm, whose octree holds the inside.
  static Result<std::unique_ptr<Pipeline>> create_fitting(const Rig& rig,
                                                          std::array<RayTable, kSensorsMax> rays,
                                                          const Wagon& wagon,
                                                          PipelineOptions& options);
  ~Pipeline();
  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;

  // The result stays valid until the next call.
  const PeopleFrame& process(const FrameSet& frames);

  // What the train says of its doors, in the wagon's order: of the instants that follow.
  void hear_doors(std::span<const DoorState> doors);

  // Learning apart from processing, for `replay --background whole` and for backgrounds kept in a
  // file. learn() only gathers evidence; finish_learning() makes what was gathered the background.
  void learn(const FrameSet& frames);
  void finish_learning();
  // The background as bytes and back; the Error names what does not fit (leaf, box, sensors).
  // Allocate.
  std::vector<std::byte> save_background() const;
  Result<void> load_background(std::span<const std::byte> bytes);

  // The zero of PeopleFrame's times (a recording's or the daemon's start); the instant of the first
  // FrameSet where it is not called. Before the first process().
  void set_start(HostTime start);

  const Occupancy& occupancy() const;
  // The foreground of the last instant, all sensors in one cloud; valid until the next process().
  std::span<const FusedPoint> fused_points() const;
  // Share of a sensor's pixels whose background is known, 0..1.
  double background_share(std::size_t sensor_index) const;
  bool learning() const;
  // A sensor's depth at the last process(), a stereo camera's as it was matched: where nothing
  // changed, the last match stays. No pixels where it had none then. Valid until the next process()
  // and no longer than that instant's frames.
  DepthImage depth_image(std::size_t sensor_index) const;
  // The rays of its pixels: those of the blob, or those made here. As long as the pipeline.
  RayTable rays(std::size_t sensor_index) const;
  // What a stereo camera says of itself, after the last process(); nullptr for other sensors.
  const StereoReport* stereo_report(std::size_t sensor_index) const;

  // Time source for stage timings; without one they are zero and results do not depend on it.
  using Ticker = Duration (*)();
  void set_ticker(Ticker ticker);
  // Of the last process(). What several workers did at the same time is counted as often.
  const std::array<Duration, kStageCount>& last_stage_times() const;

 private:
  struct State;
  explicit Pipeline(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace wagonsight
